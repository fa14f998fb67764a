# SPDX-License-Identifier: MIT
"""The centralized Kalman filter: encoders, gyro and compass in one state of eight.

In come the base velocity from count differences, the gyro's mean rate over the same interval
and now and then a compass heading; out come pose, velocity and gyro bias with their covariance,
in the `odom` frame. filterpy's extended Kalman filter does the algebra; model, noise and gates
are here. Follows Bar-Shalom, Li & Kirubarajan, "Estimation with Applications to Tracking and
Navigation" (2001), section 6.3.2, and Thrun, Burgard & Fox, "Probabilistic Robotics" (2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.config import KalmanConfig
from ins_robot.errors import StateError
from ins_robot.estimation.filterpy_ekf import ExtendedKalmanFilter
from ins_robot.geometry.angles import FloatArray, wrap_rad

# Chi-square of 4 degrees of freedom is above this once in 100,000 fair innovations.
INNOVATION_GATE = 28.5
START_VELOCITY_STD = 1e-3  # the robot starts standing


class State:
    """Where each quantity lives in the state vector."""

    X = 0
    Y = 1
    HEADING = 2
    VX = 3
    VY = 4
    YAW_RATE = 5
    GYRO_BIAS = 6
    FIELD_BEARING = 7  # of the horizontal magnetic field, in odom
    POSITION = slice(0, 2)
    POSE = slice(0, 3)
    TWIST = slice(3, 6)
    SIZE = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionNoise:
    """Standard deviations of one interval's measured velocity."""

    wheel_std_mps: float
    wheel_yaw_std_radps: float
    gyro_std_radps: float
    is_at_rest: bool = False  # what the gyro reads is its bias then


# Correlations dropped at each step: all of the pose's but those with the velocity, which last a
# few steps, and the one of heading and field's bearing, which the compass lives on.
_FORGOTTEN = (
    (State.POSITION, State.HEADING),
    (State.POSITION, State.GYRO_BIAS),
    (State.POSITION, State.FIELD_BEARING),
    (State.HEADING, State.GYRO_BIAS),
    (State.FIELD_BEARING, slice(State.VX, State.FIELD_BEARING)),
)

_WHEELS_H = np.zeros((3, State.SIZE))
_WHEELS_H[0, State.VX] = _WHEELS_H[1, State.VY] = _WHEELS_H[2, State.YAW_RATE] = 1.0
_GYRO_H = np.zeros((1, State.SIZE))
_GYRO_H[0, State.YAW_RATE] = _GYRO_H[0, State.GYRO_BIAS] = 1.0
_BOTH_H = np.vstack([_WHEELS_H, _GYRO_H])


class CentralKalman:
    """Extended Kalman filter over pose, velocity, gyro bias and bearing of the magnetic field.

    The velocity in the state is the *mean* over the interval just predicted, which is what
    count differences and an integrated gyro measure. So `predict` carries the pose by the
    velocity after its random step, and the update that follows corrects both: in steady state
    the pose integrates the measured displacement without lag.

    The field's bearing is estimated too, because where the robot starts the compass is as wrong
    as anywhere: the first reading is a guess of it, and many places together tell it.
    """

    def __init__(self, config: KalmanConfig) -> None:
        self._config = config
        self._ekf = ExtendedKalmanFilter(State.SIZE, 4)
        self._ekf.x = np.zeros(State.SIZE)
        self._ekf.predict_x = self._move  # filterpy: "override this function"
        self._dt_s = 0.0
        self.surprises = 0
        self.reset(gyro_bias_radps=0.0, gyro_bias_std_radps=0.0)

    def reset(self, *, gyro_bias_radps: float, gyro_bias_std_radps: float) -> None:
        """Start again: standing at the origin of `odom`, with a known gyro bias."""
        ekf = self._ekf
        ekf.x = np.zeros(State.SIZE)
        ekf.x[State.GYRO_BIAS] = gyro_bias_radps
        ekf.P = np.zeros((State.SIZE, State.SIZE))
        for i in range(State.TWIST.start, State.TWIST.stop):
            ekf.P[i, i] = START_VELOCITY_STD**2
        ekf.P[State.GYRO_BIAS, State.GYRO_BIAS] = gyro_bias_std_radps**2
        self._has_field = False

    @property
    def state(self) -> FloatArray:
        """(8,) state, see `State`; the heading is not wrapped. Not to be written to."""
        state: FloatArray = self._ekf.x
        return state

    @property
    def covariance(self) -> FloatArray:
        """(8, 8) covariance of `state`. Not to be written to."""
        covariance: FloatArray = self._ekf.P
        return covariance

    def predict(self, dt_s: float) -> None:
        """Move the estimate on by `dt_s` seconds at its velocity."""
        ekf, config = self._ekf, self._config
        self._forget_the_way()
        heading, vx, vy, omega = ekf.x[State.HEADING : State.GYRO_BIAS].tolist()
        # Mid-point rule: on average over an interval the base is half-way through its turn.
        middle = heading + 0.5 * omega * dt_s
        c, s = math.cos(middle), math.sin(middle)
        step_x, step_y = dt_s * (c * vx - s * vy), dt_s * (s * vx + c * vy)
        F = ekf.F
        F[State.X, 2:6] = (-step_y, dt_s * c, -dt_s * s, -0.5 * dt_s * step_y)
        F[State.Y, 2:6] = (step_x, dt_s * s, dt_s * c, 0.5 * dt_s * step_x)
        F[State.HEADING, State.YAW_RATE] = dt_s
        # Discrete white noise acceleration, constant over an interval (Bar-Shalom 6.3.2): each
        # mean velocity differs from the last by accel * dt. The pose is carried by the velocity
        # after that step, so the step goes into P before F does: F (P + q) F' + Q.
        linear_var = (config.accel_std_mps2 * dt_s) ** 2
        ekf.P[State.VX, State.VX] += linear_var
        ekf.P[State.VY, State.VY] += linear_var
        ekf.P[State.YAW_RATE, State.YAW_RATE] += (config.yaw_accel_std_radps2 * dt_s) ** 2
        # What no velocity noise explains (wheel radius, floor, gyro scale) grows with the way.
        way_var = config.odometry_std_per_m**2 * math.hypot(vx, vy) * dt_s
        Q = np.zeros((State.SIZE, State.SIZE))
        Q[State.X, State.X] = Q[State.Y, State.Y] = way_var
        Q[State.HEADING, State.HEADING] = config.heading_std_per_rad**2 * abs(omega) * dt_s
        Q[State.GYRO_BIAS, State.GYRO_BIAS] = config.bias_drift_std_radps**2 * dt_s
        ekf.Q = Q
        self._dt_s = dt_s
        ekf.predict()

    def _forget_the_way(self) -> None:
        """Let what is learnt from now on move the pose by this interval's motion only.

        Kept, the correlations would let a robot at rest, learning its gyro's bias, slide along
        the whole way behind it: right on average, but `odom` must be continuous, and what was
        driven long ago is SLAM's to correct.
        """
        P = self._ekf.P
        for first, second in _FORGOTTEN:
            P[first, second] = 0.0
            P[second, first] = 0.0

    def _move(self, _command: float = 0.0) -> None:
        """Non-linear part of the prediction: x <- f(x)."""
        x, y, heading, vx, vy, omega = self._ekf.x[: State.GYRO_BIAS].tolist()
        dt_s = self._dt_s
        middle = heading + 0.5 * omega * dt_s
        c, s = math.cos(middle), math.sin(middle)
        moved: FloatArray = self._ekf.x.copy()
        moved[State.X] = x + dt_s * (c * vx - s * vy)
        moved[State.Y] = y + dt_s * (s * vx + c * vy)
        moved[State.HEADING] = heading + dt_s * omega
        self._ekf.x = moved

    def update_wheels(
        self,
        vx_mps: float,
        vy_mps: float,
        yaw_rate_radps: float,
        noise: MotionNoise,
        gyro_radps: float | None = None,
    ) -> bool:
        """Correct with the encoders and, stacked, the gyro (bias not removed) of one interval.

        Returns False when the innovation was too large to be noise; it was then used with its
        noise inflated until it is just believable.
        """
        wheel_var = noise.wheel_std_mps**2
        variances = [wheel_var, wheel_var, noise.wheel_yaw_std_radps**2]
        if gyro_radps is None:
            return self._update([vx_mps, vy_mps, yaw_rate_radps], _WHEELS_H, variances)
        variances.append(noise.gyro_std_radps**2)
        values = [vx_mps, vy_mps, yaw_rate_radps, gyro_radps]
        return self._update(values, _BOTH_H, variances, learns_bias=noise.is_at_rest)

    def update_gyro(self, gyro_radps: float, std_radps: float) -> bool:
        """Correct with the gyro alone (bias not removed); as `update_wheels`."""
        return self._update([gyro_radps], _GYRO_H, [std_radps**2])

    def update_compass(self, direction_rad: float, std_rad: float) -> None:
        """Correct the heading by the field's direction as seen from the base.

        The first direction only tells the field's bearing. The position is never corrected:
        odometry must not jump, and what it would gain from a better heading is left to SLAM. So
        this is a Schmidt-Kalman update: the gain's position rows are zero, and the Joseph form
        keeps the covariance right for that gain.
        """
        ekf = self._ekf
        P, variance = ekf.P, std_rad**2
        heading = float(ekf.x[State.HEADING])
        if not self._has_field:
            self._has_field = True
            ekf.x[State.FIELD_BEARING] = heading + direction_rad
            P[State.FIELD_BEARING, :] = P[State.HEADING, :]  # bearing = heading + direction
            P[:, State.FIELD_BEARING] = P[:, State.HEADING]
            P[State.FIELD_BEARING, State.FIELD_BEARING] += variance
            return
        PHT = P[:, State.FIELD_BEARING] - P[:, State.HEADING]
        K = PHT / (PHT[State.FIELD_BEARING] - PHT[State.HEADING] + variance)
        K[State.POSITION] = K[State.GYRO_BIAS] = 0.0
        expected = float(ekf.x[State.FIELD_BEARING]) - heading
        ekf.x = ekf.x + K * wrap_rad(direction_rad - expected)
        I_KH = np.eye(State.SIZE)
        I_KH[:, State.FIELD_BEARING] -= K
        I_KH[:, State.HEADING] += K
        ekf.P = I_KH @ P @ I_KH.T + np.outer(K, K) * variance
        self._settle()

    def set_bias(self, bias_radps: float, std_radps: float) -> None:
        """The gyro's bias has stepped: what it was says nothing about what it is."""
        ekf = self._ekf
        ekf.x = ekf.x.copy()
        ekf.x[State.GYRO_BIAS] = bias_radps
        ekf.P[State.GYRO_BIAS, :] = ekf.P[:, State.GYRO_BIAS] = 0.0
        ekf.P[State.GYRO_BIAS, State.GYRO_BIAS] = std_radps**2

    def _update(
        self,
        values: list[float],
        H: FloatArray,
        variances: list[float],
        *,
        learns_bias: bool = True,
    ) -> bool:
        """Correct; without `learns_bias` as a Schmidt-Kalman update that leaves it alone.

        Unequal wheels turn a driving base a little, always the same way: no noise, but minutes
        of it would pass for the gyro's bias.
        """
        ekf = self._ekf
        x_prior, P_prior = ekf.x, ekf.P
        z, R = np.array(values), np.diag(variances)
        ekf.update(z, lambda _x: H, H.dot, R=R)
        surprise = float(ekf.y @ ekf.SI @ ekf.y)  # normalised innovation squared
        # NaN is not for the gate: `_settle` refuses it.
        is_plausible = surprise <= INNOVATION_GATE or not math.isfinite(surprise)
        if not is_plausible:
            self.surprises += 1
            ekf.x, ekf.P = x_prior, P_prior
            R *= surprise / INNOVATION_GATE
            ekf.update(z, lambda _x: H, H.dot, R=R)
        if not learns_bias:
            K = ekf.K
            K[State.GYRO_BIAS] = 0.0
            I_KH = np.eye(State.SIZE) - K @ H
            ekf.x = x_prior + K @ ekf.y
            ekf.P = I_KH @ P_prior @ I_KH.T + K @ R @ K.T
        self._settle()
        return is_plausible

    def _settle(self) -> None:
        """Remove what rounding does to the symmetry of P; refuse to go on with NaN."""
        P = self._ekf.P
        self._ekf.P = 0.5 * (P + P.T)
        if not math.isfinite(float(self._ekf.x.sum()) + float(P.sum())):
            raise StateError(
                "the Kalman filter's state is no longer finite: an input or the [kalman] "
                "noise settings are far out of range; restart the run"
            )
