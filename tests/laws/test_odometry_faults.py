# SPDX-License-Identifier: MIT
"""One thing goes wrong with a good drive; each test says what the odometry makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from driven_robot import TICK_S, DrivenRobot, Velocity, standing

from ins_robot.config import ImuConfig, KalmanConfig
from ins_robot.core.odometry import Verdict
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import ImuSample, WheelSample

CALIBRATION_S = 2.5


def ready(**options: object) -> DrivenRobot:
    robot = DrivenRobot(**options)  # type: ignore[arg-type]
    robot.drive(standing, CALIBRATION_S)
    assert robot.odometry.is_ready
    return robot


def ahead(t_s: float) -> Velocity:
    return 0.2 * min(t_s, 1.0), 0.0, 0.0


def heading_off_rad(robot: DrivenRobot) -> float:
    return abs(wrap_rad(robot.odometry.pose.heading_rad - robot.truth[2]))


def imu(robot: DrivenRobot, ahead_s: float, rate_radps: float) -> ImuSample:
    return ImuSample(stamp_s=robot.now_s + ahead_s, yaw_rate_radps=rate_radps)


def test_bias_is_learnt_only_standing() -> None:
    """Turning during start-up: no bias; after bias_time_s of rest: the right one."""
    robot = DrivenRobot(bias_radps=0.05)
    robot.drive(lambda _t: (0.0, 0.0, 0.3), 5.0)
    assert not robot.odometry.is_ready
    robot.drive(standing, 1.8)
    assert not robot.odometry.is_ready
    robot.drive(standing, 0.4)
    assert robot.odometry.is_ready
    assert robot.odometry.gyro_bias_radps == pytest.approx(0.05, abs=1e-6)
    assert robot.odometry.pose == Pose2()


def test_shaking_is_no_standstill() -> None:
    robot = DrivenRobot(gyro_std_radps=math.radians(1.0))
    robot.drive(standing, 7.0)
    assert not robot.odometry.is_ready
    assert robot.odometry.verdicts["bias.refused"] == 3


def test_slip_is_seen_and_doubted() -> None:
    """Wheels that spin without turning the body: heading from the gyro, position in doubt."""
    robot = ready()
    robot.drive(ahead, 3.0)
    before = robot.odometry.increment(robot.now_s - 1.0, robot.now_s).covariance
    robot.wheel_slip = (0.0, 0.1, 0.5)
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 1.0)
    assert robot.odometry.is_slipping
    assert robot.odometry.verdicts["wheels.slip"] >= 45
    assert heading_off_rad(robot) < math.radians(1.0)
    after = robot.odometry.increment(robot.now_s - 1.0, robot.now_s).covariance
    assert after[0, 0] > 8.0 * before[0, 0]
    # The doubt covers the error.
    error_m = robot.odometry.pose.distance_m(robot.pose)
    assert error_m < 3.0 * math.sqrt(after[0, 0] + after[1, 1])
    robot.wheel_slip = (0.0, 0.0, 0.0)
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 0.5)
    assert not robot.odometry.is_slipping


def test_being_turned_by_hand_is_no_bias() -> None:
    """Wheels rest, the gyro turns: the heading goes along, the bias stays.

    A turn so slow that a drifting bias might do it is taken for one, until the next rest.
    """
    robot = ready()
    robot.drive(standing, 1.0)

    def turned(t_s: float) -> Velocity:
        return 0.0, 0.0, 0.5 * math.sin(math.pi * t_s / 4.0)

    begin_s = robot.now_s
    for k in range(200):
        t = begin_s + k * TICK_S
        rate = turned(t - begin_s)[2] + robot.bias_radps
        robot.odometry.on_imu(ImuSample(stamp_s=t + 0.006, yaw_rate_radps=rate))
        robot.odometry.on_wheels(
            WheelSample(stamp_s=t + TICK_S, device_s=t + TICK_S, counts=robot.counts())
        )
    angle = 0.5 * 8.0 / math.pi  # integral of the sine
    assert robot.odometry.pose.heading_rad == pytest.approx(angle, abs=0.02)
    assert robot.odometry.gyro_bias_radps == pytest.approx(robot.bias_radps, abs=8e-4)
    robot.drive(standing, 5.0)
    assert robot.odometry.gyro_bias_radps == pytest.approx(robot.bias_radps, abs=4e-4)


def test_gyro_spike_is_refused() -> None:
    robot = ready()
    robot.drive(ahead, 2.0)
    assert robot.odometry.on_imu(imu(robot, 0.001, 4.0)) is Verdict.IMPLAUSIBLE
    assert robot.odometry.on_imu(imu(robot, 0.002, math.nan)) is Verdict.IMPLAUSIBLE
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 1.0)
    assert heading_off_rad(robot) < 1e-3


def test_a_jump_that_lasts_is_believed() -> None:
    """A hard knock turns the robot at once: the second reading confirms the first."""
    robot = ready()
    assert robot.odometry.on_imu(imu(robot, 0.005, 2.5)) is Verdict.IMPLAUSIBLE
    assert robot.odometry.on_imu(imu(robot, 0.010, 2.6)) is Verdict.ACCEPTED


def test_readings_out_of_order_are_stale() -> None:
    robot = ready()
    robot.drive(ahead, 1.0)
    before = robot.odometry.pose
    assert robot.odometry.on_imu(imu(robot, -1.0, 0.02)) is Verdict.STALE
    again = WheelSample(stamp_s=robot.now_s, device_s=robot.now_s, counts=(9, 9, 9))
    assert robot.odometry.on_wheels(again) is Verdict.STALE
    assert robot.odometry.pose == before


def test_without_a_gyro_the_wheels_carry_on() -> None:
    """The gyro dies while turning: heading from the wheels, and its return makes no jump."""
    robot = ready()

    def turning(_t: float) -> Velocity:
        return 0.1, 0.0, 0.4

    robot.drive(turning, 2.0)
    robot.has_gyro = False
    robot.drive(turning, 3.0)
    assert heading_off_rad(robot) < math.radians(0.5)
    robot.has_gyro = True
    robot.drive(turning, 1.0)
    assert heading_off_rad(robot) < math.radians(1.0)
    # 3 s on wheels (0.05 rad/s) are worth less than 3 s with a gyro (0.002 rad/s).
    with_gyro = robot.odometry.increment(3.5, 4.5).covariance[2, 2]
    without = robot.odometry.increment(6.0, 7.0).covariance[2, 2]
    assert without > with_gyro * 1.2


def test_restart_of_the_microcontroller_is_no_motion() -> None:
    robot = ready()
    robot.drive(ahead, 3.0)
    at_s, before = robot.now_s, robot.odometry.pose
    fresh = WheelSample(stamp_s=at_s + 0.3, device_s=0.01, counts=(0, 0, 0))
    assert robot.odometry.on_wheels(fresh) is Verdict.RESTARTED
    # It was rolling at 0.2 m/s and may have gone on, or not: 6 cm of doubt.
    motion = robot.odometry.increment(at_s, at_s + 0.3)
    assert motion.delta.x_m == pytest.approx(0.06, abs=0.01)
    assert math.sqrt(motion.covariance[0, 0]) >= 0.05
    later = WheelSample(stamp_s=at_s + 0.32, device_s=0.03, counts=(0, 0, 0))
    assert robot.odometry.on_wheels(later) in (Verdict.ACCEPTED, Verdict.SURPRISING)
    assert robot.odometry.pose.distance_m(before) < 0.09


def test_counts_no_wheel_can_make_are_refused() -> None:
    """One frame with a wild total is left out; totals that stay wild are a new reference."""
    robot = ready()
    robot.drive(ahead, 2.0)
    a, b, c = robot.counts()
    before = robot.odometry.pose
    verdicts = []
    for k in range(1, 5):
        t = robot.now_s + k * TICK_S
        wild = WheelSample(stamp_s=t, device_s=t, counts=(a + 50_000, b, c))
        verdicts.append(robot.odometry.on_wheels(wild))
    assert verdicts[:3] == [Verdict.IMPLAUSIBLE, Verdict.IMPLAUSIBLE, Verdict.RESTARTED]
    assert verdicts[3] in (Verdict.ACCEPTED, Verdict.SURPRISING)
    assert robot.odometry.pose.distance_m(before) < 0.05


def test_lost_frames_lose_no_way() -> None:
    """Totals are kept by the encoder: a gap of 0.3 s is bridged by its counts and gyro."""
    robot = ready()
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 1.0)
    pose, on_wheels = robot.odometry.pose, robot.odometry.on_wheels
    robot.odometry.on_wheels = lambda _sample: Verdict.STALE  # type: ignore[method-assign]
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 0.3)
    robot.odometry.on_wheels = on_wheels  # type: ignore[method-assign]
    robot.drive(lambda _t: (0.2, 0.0, 0.0), 0.1)
    assert robot.odometry.pose.x_m - pose.x_m == pytest.approx(0.08, abs=1e-3)


# The compass.

EARTH = (0.2, 0.05, -0.4)


def earth(pose: Pose2) -> tuple[float, float, float]:
    x, y, z = EARTH
    c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    return c * x + s * y, c * y - s * x, z


def heading_after_turns(
    field: object, *, scale: float, minutes: float = 2.0, **kalman: float
) -> float:
    """Heading error in degrees after turning on and on with a gyro wrong by `scale`."""
    config = KalmanConfig(wheel_yaw_std_radps=1.0, slip_gate_radps=9.0, **kalman)
    robot = ready(kalman=config, imu=ImuConfig(gyro_scale=scale))
    robot.field = field  # type: ignore[assignment]
    on_imu = robot.odometry.on_imu

    def scaled(sample: ImuSample) -> Verdict:
        return on_imu(
            ImuSample(
                stamp_s=sample.stamp_s,
                field_gauss=sample.field_gauss,
                yaw_rate_radps=0.02 + (sample.yaw_rate_radps - 0.02) * scale,
            )
        )

    robot.odometry.on_imu = scaled  # type: ignore[method-assign]
    robot.drive(standing, 1.0)
    robot.drive(lambda _t: (0.2, 0.0, 0.3), 60.0 * minutes)
    return math.degrees(heading_off_rad(robot))


def test_compass_bounds_what_a_wrong_gyro_scale_does() -> None:
    """2 % over 36 rad are 41 deg without a compass; the filter is told how bad the gyro is."""
    without = heading_after_turns(None, scale=1.02)
    assert without == pytest.approx(41.0, abs=3.0)
    told = heading_after_turns(earth, scale=1.02, compass_std_deg=5.0, heading_std_per_rad=0.02)
    assert told < 0.4 * without


def test_metal_does_not_turn_the_robot() -> None:
    """A field that is 40 deg off in half of the room, with a good gyro."""

    def metal(pose: Pose2) -> tuple[float, float, float]:
        off = math.radians(40.0) if pose.x_m > 0.0 else 0.0
        return earth(Pose2(pose.x_m, pose.y_m, pose.heading_rad + off))

    assert heading_after_turns(metal, scale=1.0) < 6.0


def test_field_of_the_wrong_strength_is_refused() -> None:
    robot = ready()
    robot.field = earth
    robot.drive(standing, 1.0)
    robot.field = lambda pose: tuple(1.5 * v for v in earth(pose))  # type: ignore[assignment,return-value]
    accepted = robot.odometry.verdicts["compass.accepted"]
    robot.drive(ahead, 3.0)
    assert robot.odometry.verdicts["compass.accepted"] == accepted
    assert robot.odometry.verdicts["compass.norm"] == 50


def test_compass_never_moves_the_position() -> None:
    """Odometry is continuous: no step is longer than the wheels made it."""
    robot = ready(kalman=KalmanConfig(compass_std_deg=1.0, heading_std_per_rad=0.2))
    robot.field = earth
    robot.drive(lambda t: (0.2 * min(t, 1.0), 0.0, 0.1 * min(t, 1.0)), 10.0)
    robot.field = lambda pose: earth(Pose2(0.0, 0.0, pose.heading_rad + 0.05))
    robot.drive(lambda _t: (0.2, 0.0, 0.1), 15.0)
    assert robot.odometry.verdicts["compass.accepted"] > 300
    assert heading_off_rad(robot) > 0.02  # it did correct the heading
    stamps_s = np.arange(CALIBRATION_S, robot.now_s, TICK_S)
    steps = np.hypot(*np.diff(robot.odometry.poses_at(stamps_s)[:, :2], axis=0).T)
    assert steps.max() < 0.2 * TICK_S * 1.05


def turning_and_driving(t_s: float) -> Velocity:
    return 0.2 * min(t_s, 1.0), 0.0, 0.3 * math.sin(0.5 * t_s)


@pytest.mark.parametrize("step_dps", [2.0, -1.0, 0.5])
def test_a_step_of_the_bias_is_learnt_within_a_second_of_rest_and_doubted_back(
    step_dps: float,
) -> None:
    """Nobody knows when on the way it stepped: all of the way may be off by all of it."""
    robot = ready(gyro_std_radps=5e-4)
    robot.drive(ahead, 3.0)
    begun_s = robot.now_s
    robot.bias_radps += math.radians(step_dps)
    robot.drive(turning_and_driving, 6.0)
    robot.drive(standing, 1.2)
    assert robot.odometry.gyro_bias_radps == pytest.approx(robot.bias_radps, abs=1e-3)
    assert robot.odometry.verdicts["bias.stepped"] == 1
    off_rad = heading_off_rad(robot)
    assert off_rad > math.radians(4.0 * abs(step_dps))
    motion = robot.odometry.increment(begun_s, robot.now_s)
    assert off_rad < 2.0 * math.sqrt(motion.covariance[2, 2])
    later = robot.odometry.increment(robot.now_s - 0.1, robot.now_s)
    assert math.sqrt(later.covariance[2, 2]) < math.radians(0.1)


def test_the_gyro_is_suspected_on_the_way_when_it_leaves_the_wheels() -> None:
    robot = ready(gyro_std_radps=5e-4, wheel_yaw_std_radps=0.01)
    robot.drive(turning_and_driving, 40.0)
    before = robot.odometry.increment(robot.now_s - 8.0, robot.now_s).covariance[2, 2]
    robot.bias_radps += math.radians(2.0)
    robot.drive(lambda t: turning_and_driving(t + 40.0), 8.0)
    after = robot.odometry.increment(robot.now_s - 8.0, robot.now_s).covariance[2, 2]
    assert math.sqrt(before) < math.radians(1.0)
    assert heading_off_rad(robot) < 2.0 * math.sqrt(after)


def test_a_small_wander_of_the_bias_is_no_step() -> None:
    robot = ready(gyro_std_radps=5e-4)
    for _ in range(5):
        robot.bias_radps += math.radians(0.02)
        robot.drive(ahead, 3.0)
        robot.drive(standing, 3.0)
    assert "bias.stepped" not in robot.odometry.verdicts
    assert robot.odometry.gyro_bias_radps == pytest.approx(robot.bias_radps, abs=2e-3)


def test_a_bias_that_drifts_through_a_long_rest_is_no_step() -> None:
    robot = ready(gyro_std_radps=5e-4)
    robot.drive(ahead, 3.0)
    for _ in range(40):
        robot.bias_radps += 1e-4
        robot.drive(standing, 1.0)
    assert "bias.stepped" not in robot.odometry.verdicts
    motion = robot.odometry.increment(robot.now_s - 42.0, robot.now_s)
    assert math.sqrt(motion.covariance[2, 2]) < math.radians(0.2)
