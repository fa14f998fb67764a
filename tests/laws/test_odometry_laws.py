# SPDX-License-Identifier: MIT
"""What holds for the odometry whatever the drive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from driven_robot import TICK_S, DrivenRobot, Velocity, standing

from ins_robot.config import KalmanConfig, WheelsConfig
from ins_robot.errors import StateError
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2

CALIBRATION_S = 3.0


def circle(t_s: float) -> Velocity:
    """One turn of 15 s with 1 s of ramp at either end: the end is the beginning."""
    ramp = min(max(t_s, 0.0), 1.0, max(0.0, 16.0 - t_s))
    return 0.2 * ramp, 0.0, 2.0 * math.pi / 15.0 * ramp


def spiral(t_s: float) -> Velocity:
    """Forward, sideways and turning at once, as only an omni base can."""
    return 0.15 * math.sin(0.7 * t_s), 0.12 * math.cos(0.4 * t_s) - 0.05, math.sin(0.5 * t_s)


@pytest.mark.parametrize("imu_phase_s", [0.0, 0.006, 0.018])
def test_a_circle_ends_where_it_began(imu_phase_s: float) -> None:
    robot = DrivenRobot(imu_phase_s=imu_phase_s)
    robot.drive(standing, CALIBRATION_S)
    robot.drive(circle, 18.0)
    assert robot.pose.distance_m(Pose2()) < 1e-6
    assert robot.odometry.pose.distance_m(Pose2()) < 1e-3
    assert abs(robot.odometry.pose.heading_rad) < math.radians(0.1)


def test_any_drive_is_followed_within_millimetres() -> None:
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    for k in range(10):
        robot.drive(lambda t, k=k: spiral(t + 3.0 * k), 3.0)
        assert robot.odometry.pose.distance_m(robot.pose) < 2e-3
        off = wrap_rad(robot.odometry.pose.heading_rad - robot.pose.heading_rad)
        assert abs(off) < math.radians(0.3)


def test_heading_stands_while_the_robot_stands() -> None:
    """As during every scan: a minute of noise and drifting bias turns it by under 0.02 deg."""
    robot = DrivenRobot(gyro_std_radps=9e-4)
    robot.drive(standing, CALIBRATION_S)
    before = robot.odometry.pose
    for _ in range(60):
        robot.bias_radps += 3.5e-5 * float(robot.rng.standard_normal())
        robot.drive(standing, 1.0)
    assert abs(robot.odometry.pose.heading_rad - before.heading_rad) < math.radians(0.02)
    assert robot.odometry.pose.distance_m(before) < 1e-9
    # ... and the bias has been followed meanwhile.
    assert abs(robot.odometry.gyro_bias_radps - robot.bias_radps) < 2e-4


def test_same_inputs_give_identical_floats() -> None:
    def run() -> tuple[bytes, bytes]:
        robot = DrivenRobot(gyro_std_radps=9e-4, wheel_std_mps=0.005, seed=3)
        robot.drive(standing, CALIBRATION_S)
        robot.drive(spiral, 5.0)
        stamps_s = np.linspace(3.0, robot.now_s, 50)
        poses = robot.odometry.poses_at(stamps_s)
        return poses.tobytes(), robot.odometry.covariance.tobytes()

    assert run() == run()


def test_increment_covariance_is_the_error_s() -> None:
    """Normalised error squared over many drives: mean 3 for three degrees of freedom."""
    kalman = KalmanConfig(heading_std_per_rad=1e-6)
    wheels = WheelsConfig(pulses_per_rev=100_000)
    squares = []
    for seed in range(30):
        robot = DrivenRobot(
            kalman=kalman,
            wheels=wheels,
            seed=seed,
            gyro_std_radps=kalman.gyro_std_radps,
            wheel_std_mps=kalman.wheel_std_mps,
            wheel_yaw_std_radps=kalman.wheel_yaw_std_radps,
            way_std=kalman.odometry_std_per_m,
        )
        robot.drive(standing, 2.2)
        robot.drive(spiral, 1.0)
        from_s, start = robot.now_s, robot.pose
        robot.drive(lambda t: spiral(t + 1.0), 4.0)
        motion = robot.odometry.increment(from_s, robot.now_s)
        error = motion.delta.inverse() @ start.between(robot.pose)
        e = error.as_array()
        # The error is in the frame at the end, the covariance in the frame at the start.
        c, s = math.cos(motion.delta.heading_rad), math.sin(motion.delta.heading_rad)
        e[:2] = c * e[0] - s * e[1], s * e[0] + c * e[1]
        squares.append(float(e @ np.linalg.solve(motion.covariance, e)))
    # The mean of 30 chi-square(3) is 3 +- 0.45; a standard deviation wrong by a third fails.
    assert 1.8 < np.mean(squares) < 4.2


def test_increments_chain() -> None:
    """From a to b to c is from a to c: the motion exactly, the covariance nearly."""
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    robot.drive(spiral, 6.0)
    odometry = robot.odometry
    first, second = odometry.increment(4.0, 6.013), odometry.increment(6.013, 8.5)
    whole = odometry.increment(4.0, 8.5)
    chained = first.delta @ second.delta
    assert chained.distance_m(whole.delta) < 1e-9
    assert wrap_rad(chained.heading_rad - whole.delta.heading_rad) == pytest.approx(0, abs=1e-9)
    # Law of propagation: J1 C1 J1' + J2 C2 J2' for independent parts.
    c, s = math.cos(first.delta.heading_rad), math.sin(first.delta.heading_rad)
    x, y = second.delta.x_m, second.delta.y_m
    j1 = np.array([[1.0, 0.0, -s * x - c * y], [0.0, 1.0, c * x - s * y], [0.0, 0.0, 1.0]])
    j2 = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    expected = j1 @ first.covariance @ j1.T + j2 @ second.covariance @ j2.T
    np.testing.assert_allclose(whole.covariance, expected, rtol=0.02, atol=1e-8)


def test_uncertainty_grows_with_the_way_and_not_with_time() -> None:
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 10.0)
    after_way = robot.odometry.increment(CALIBRATION_S, robot.now_s).covariance
    expected_m = KalmanConfig().odometry_std_per_m * math.sqrt(2.0)
    assert math.sqrt(after_way[0, 0]) == pytest.approx(expected_m, rel=0.15)
    robot.drive(standing, 75.0)
    after_rest = robot.odometry.increment(CALIBRATION_S, robot.now_s).covariance
    np.testing.assert_allclose(after_rest[:2, :2], after_way[:2, :2], rtol=0.02, atol=5e-7)
    assert after_rest[2, 2] <= 1.02 * after_way[2, 2]  # less: rest told the bias it relied on


def test_poses_between_and_beyond_samples() -> None:
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    robot.drive(lambda t: (min(t, 1.0) * 0.2, 0.0, 0.0), 5.0)
    end_s, end = robot.now_s, robot.odometry.pose
    stamps_s = np.array(
        [end_s - 0.5 * TICK_S, end_s, end_s + 0.05, end_s + 0.1, end_s + 9.0, -5.0]
    )
    x = robot.odometry.poses_at(stamps_s)[:, 0] - end.x_m
    np.testing.assert_allclose(x[:4], [-0.002, 0.0, 0.01, 0.02], atol=2e-4)
    assert x[4] == x[3]  # a stop of the wheels' stream is not driven into
    assert x[5] == -end.x_m


def test_a_turn_through_pi_interpolates_the_short_way() -> None:
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    robot.drive(lambda _t: (0.0, 0.0, 1.0), 4.0)
    headings = robot.odometry.poses_at(np.arange(5.0, 7.0, 0.003))[:, 2]
    assert headings.min() < -2.5
    assert headings.max() > 2.5
    assert np.abs(wrap_rad(np.diff(headings))).max() < 0.004


def test_history_too_old_is_refused() -> None:
    robot = DrivenRobot()
    robot.drive(standing, CALIBRATION_S)
    with pytest.raises(StateError, match="history begins at"):
        robot.odometry.increment(-10.0, 1.0)
    with pytest.raises(StateError, match="backwards"):
        robot.odometry.increment(2.0, 1.0)
