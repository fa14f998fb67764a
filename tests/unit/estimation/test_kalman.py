# SPDX-License-Identifier: MIT
"""The filter against hand-written algebra, and the claims of its docstrings."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from ins_robot.config import KalmanConfig
from ins_robot.errors import StateError
from ins_robot.estimation.kalman import CentralKalman, MotionNoise, State

NOISE = MotionNoise(wheel_std_mps=0.01, wheel_yaw_std_radps=0.05, gyro_std_radps=0.002)
DT = 0.02


def started(**config: float) -> CentralKalman:
    kalman = CentralKalman(KalmanConfig(**config))
    kalman.reset(gyro_bias_radps=0.01, gyro_bias_std_radps=1e-4)
    return kalman


def moving(steps: int = 60, **config: float) -> CentralKalman:
    kalman = started(**config)
    for k in range(steps):
        ramp = min(1.0, k / 25)
        kalman.predict(DT)
        kalman.update_wheels(0.2 * ramp, 0.05 * ramp, 0.4 * ramp, NOISE, 0.4 * ramp + 0.01)
    return kalman


def test_jacobian_is_the_derivative_of_the_motion() -> None:
    """F as the filter uses it, against finite differences of the state's own motion."""
    kalman = moving()
    ekf = kalman._ekf
    x0, P0 = kalman.state.copy(), kalman.covariance.copy()
    kalman.predict(0.1)
    jacobian, moved = ekf.F.copy(), kalman.state.copy()
    for i in range(State.SIZE):
        ekf.x, ekf.P = x0.copy(), P0.copy()
        ekf.x[i] += 1e-6
        kalman.predict(0.1)
        np.testing.assert_allclose((kalman.state - moved) / 1e-6, jacobian[:, i], atol=1e-6)


def test_covariance_stays_symmetric_and_positive() -> None:
    kalman = moving(2000)
    for _ in range(50):
        kalman.update_compass(0.3, 0.2)
    P = kalman.covariance
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > -1e-12


def test_stacked_update_is_the_information_sum() -> None:
    """(P^-1 + H' R^-1 H)^-1, which needs no gain."""
    kalman = moving()
    kalman.predict(DT)
    P = kalman.covariance[:7, :7].copy()  # the field's bearing is not in use: no variance yet
    H = np.zeros((4, 7))
    H[0, State.VX] = H[1, State.VY] = H[2, State.YAW_RATE] = H[3, State.YAW_RATE] = 1.0
    H[3, State.GYRO_BIAS] = 1.0
    R = np.diag([0.01**2, 0.01**2, 0.05**2, 0.002**2])
    kalman.update_wheels(0.2, 0.05, 0.4, NOISE, 0.41)
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    np.testing.assert_allclose(kalman.covariance[:7, :7], expected, rtol=1e-5, atol=1e-12)


def test_steady_state_integrates_the_measured_way_without_lag() -> None:
    kalman, way_m = started(), 0.0
    for k in range(200):
        speed = 0.2 * min(1.0, k / 25)
        kalman.predict(DT)
        kalman.update_wheels(speed, 0.0, 0.0, NOISE, 0.01)
        way_m += speed * DT
    x = float(kalman.state[State.X])
    assert x == pytest.approx(way_m, abs=1e-4)
    kalman.predict(DT)
    kalman.update_wheels(0.23, 0.0, 0.0, NOISE, 0.01)
    assert float(kalman.state[State.X]) - x == pytest.approx(0.23 * DT, abs=1e-5)


def test_rest_makes_the_gyro_its_own_bias() -> None:
    kalman = moving()
    rest = MotionNoise(
        wheel_std_mps=2e-4, wheel_yaw_std_radps=2e-4, gyro_std_radps=0.002, is_at_rest=True
    )
    for _ in range(20 * 50):
        kalman.predict(DT)
        kalman.update_wheels(0.0, 0.0, 0.0, rest, 0.0115)
    assert float(kalman.state[State.GYRO_BIAS]) == pytest.approx(0.0115, abs=3e-4)


def test_unequal_wheels_do_not_pass_for_the_gyros_bias() -> None:
    """A minute ahead on a wheel 1 % too large: the encoders see a turn, the gyro none."""
    kalman = CentralKalman(KalmanConfig())
    kalman.reset(gyro_bias_radps=0.0, gyro_bias_std_radps=1e-4)
    for _ in range(60 * 50):
        kalman.predict(DT)
        kalman.update_wheels(0.2, 0.0, 0.013, NOISE, 0.0)
    assert float(kalman.state[State.GYRO_BIAS]) == 0.0
    assert abs(float(kalman.state[State.HEADING])) < 0.01


def test_surprise_is_used_with_care() -> None:
    """What no noise explains moves the state, but by far less than it asks for."""
    kalman = moving()
    kalman.predict(DT)
    before = float(kalman.state[State.VX])
    assert not kalman.update_wheels(before + 0.5, 0.05, 0.4, NOISE, 0.41)
    assert kalman.surprises == 1
    assert 0.0 < float(kalman.state[State.VX]) - before < 0.2


def test_compass_corrects_heading_and_bearing_never_position() -> None:
    kalman = moving()
    kalman.update_compass(0.5 - float(kalman.state[State.HEADING]), 0.1)  # the field is at 0.5
    assert float(kalman.state[State.FIELD_BEARING]) == pytest.approx(0.5)
    for _ in range(50):
        kalman.predict(DT)
        kalman.update_wheels(0.2, 0.05, 0.4, NOISE, 0.41)
    before, heading_var = kalman.state.copy(), float(kalman.covariance[2, 2])
    position_cov = kalman.covariance[:2, :2].copy()
    direction = 0.5 - float(before[State.HEADING]) - 0.2  # says: turned 0.2 rad more
    kalman.update_compass(direction, 0.05)
    np.testing.assert_array_equal(kalman.state[State.POSITION], before[State.POSITION])
    np.testing.assert_array_equal(kalman.covariance[:2, :2], position_cov)
    assert 0.0 < float(kalman.state[State.HEADING] - before[State.HEADING]) < 0.2
    assert float(kalman.state[State.FIELD_BEARING]) < 0.5  # it takes its share
    assert float(kalman.covariance[2, 2]) < heading_var


def test_compass_update_is_the_same_a_turn_later() -> None:
    one, other = moving(), moving()
    for kalman, turns in ((one, 0), (other, 3)):
        kalman.update_compass(0.1, 0.1)
        kalman.predict(DT)
        kalman.update_compass(0.2 + 2.0 * math.pi * turns, 0.1)
    np.testing.assert_allclose(one.state, other.state, atol=1e-12)


def test_two_filters_share_nothing() -> None:
    one, other = started(), started()
    one.predict(DT)
    one.update_wheels(0.2, 0.0, 0.4, NOISE, 0.41)
    np.testing.assert_array_equal(other.state, started().state)


def test_nan_is_refused() -> None:
    kalman = started()
    kalman.predict(DT)
    with pytest.raises(StateError, match="no longer finite"):
        kalman.update_wheels(math.nan, 0.0, 0.0, NOISE)


def test_a_robot_at_rest_that_learns_its_bias_does_not_slide_along_its_way() -> None:
    """After a drive with a wrong gyro bias, standing still tells the bias and moves nothing."""
    kalman = CentralKalman(KalmanConfig())
    kalman.reset(gyro_bias_radps=0.0, gyro_bias_std_radps=0.02)
    driving = MotionNoise(wheel_std_mps=0.01, wheel_yaw_std_radps=0.05, gyro_std_radps=0.002)
    resting = MotionNoise(
        wheel_std_mps=1e-4, wheel_yaw_std_radps=1e-4, gyro_std_radps=0.002, is_at_rest=True
    )
    for _ in range(2000):
        kalman.predict(0.02)
        kalman.update_wheels(0.2, 0.0, 0.0, driving, gyro_radps=0.005)
    for _ in range(5):  # the last of the motion
        kalman.predict(0.02)
        kalman.update_wheels(0.0, 0.0, 0.0, resting, gyro_radps=0.005)
    stopped = kalman.state[State.POSE].copy()
    for _ in range(500):
        kalman.predict(0.02)
        kalman.update_wheels(0.0, 0.0, 0.0, resting, gyro_radps=0.005)
    assert kalman.state[State.GYRO_BIAS] == pytest.approx(0.005, abs=2e-4)
    assert np.abs(kalman.state[State.POSE] - stopped).max() < 1e-4


def test_the_filter_comes_without_scipy_stats_and_still_has_its_likelihood():
    code = (
        "import sys, numpy as np; "
        "from ins_robot.estimation.filterpy_ekf import ExtendedKalmanFilter; "
        "assert 'scipy.stats' not in sys.modules; "
        "ekf = ExtendedKalmanFilter(1, 1); "
        "ekf.update(np.array([[1.0]]), lambda x: np.eye(1), lambda x: x); "
        "print(ekf.log_likelihood); "
        "import filterpy.stats; "
        "assert filterpy.stats.gaussian"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(-0.5 * (math.log(4.0 * math.pi) + 0.5))
