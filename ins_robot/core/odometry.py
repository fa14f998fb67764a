# SPDX-License-Identifier: MIT
"""Gyro, compass and wheels into one pose: what is believed, what is refused, and why.

In come ImuSample and WheelSample, each at its own 50 Hz; out come pose, velocity, covariance
and motion increments in the `odom` frame, which begins where the robot stood when its gyro bias
was known. One step of `CentralKalman` per wheel sample. A robot whose encoders rest stands
still: then, as a zero-velocity update, what the gyro reads *is* its bias.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from enum import StrEnum

from ins_robot.config import ImuConfig, KalmanConfig, WheelsConfig
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.core.bias_watch import STEP_MIN_RADPS, BiasWatch
from ins_robot.core.gyro_integral import GyroIntegral
from ins_robot.core.pose_history import EXTRAPOLATE_MAX_S, BiasDoubt, PoseHistory
from ins_robot.estimation.kalman import CentralKalman, MotionNoise, State
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import ImuSample, MotionIncrement, VelocityCommand, WheelSample
from ins_robot.sensing.imu_calibration import (
    CompassGate,
    GyroBias,
    StandstillBias,
)

GYRO_MAX_RADPS = math.radians(2000.0)  # the widest range of the chip
GYRO_JUMP_MAX_RADPS = 1.5  # between two readings: 75 rad/s^2 is a glitch, not this robot
WHEEL_SPEED_MARGIN = 1.5  # of the configured maximum; faster is no rotation of a wheel
IMPLAUSIBLE_MAX = 3  # as many in a row: the encoder totals have really changed
REST_AFTER_S = 0.5  # encoders quiet for this long: standing
REST_COUNTS = 1  # an encoder on an edge may flicker by one
REST_GYRO_RADPS = 0.05  # standing on resting wheels, yet turning faster: being carried
REST_STD_MPS = 2e-4
REST_STD_RADPS = 2e-4
BIAS_STD_MIN_RADPS = 2e-5
BIAS_STEP_STD_RADPS = 5e-4  # of a bias heard at rest
BIAS_DOUBTS_MAX = 256
STAMP_STEP_MIN_S = 1e-6  # frames read together may share a stamp
LONG_REST_S = 60.0  # from then on the history keeps one pose a second


class Verdict(StrEnum):
    """What became of a sample."""

    ACCEPTED = "accepted"
    CALIBRATING = "calibrating"  # it went into the start-up bias
    STALE = "stale"  # not newer than the last
    IMPLAUSIBLE = "implausible"  # no such motion; refused
    SLIP = "slip"  # wheels and gyro disagree; used with inflated noise
    SURPRISING = "surprising"  # unlike the prediction; used with inflated noise
    RESTARTED = "restarted"  # the microcontroller began anew; a new reference


class Odometry:
    """The robot's own idea of its motion."""

    def __init__(self, kalman: KalmanConfig, imu: ImuConfig, wheels: WheelsConfig) -> None:
        self._config = kalman
        self._imu_config = imu
        self._kinematics = OmniKinematics(wheels)
        self._counts_per_s_max = (
            WHEEL_SPEED_MARGIN
            * wheels.speed_max_radps
            * wheels.pulses_per_rev
            * wheels.quadrature
            / (2.0 * math.pi)
        )
        self._kalman = CentralKalman(kalman)
        self._history = PoseHistory()
        self._gyro = GyroIntegral()
        self._standstill = StandstillBias(imu)
        self._compass = CompassGate(imu)
        self._is_ready = False
        self._pose = Pose2()
        self._twist = VelocityCommand()
        self._is_slipping = False
        self._slip_steps = 0
        self._stamp_s = -math.inf
        self._wheels: WheelSample | None = None
        self._implausible_wheels = 0
        self._imu_stamp_s = -math.inf
        self._rate_radps = 0.0
        self._doubtful_radps: float | None = None
        self._rest_counts = (0, 0, 0)
        self._rest_since_s = 0.0
        self._way_m = 0.0  # since the compass was last used
        self._bias_watch = BiasWatch()
        self._last_bias_radps = 0.0  # what was last taken for the bias
        self._bias_doubts: deque[BiasDoubt] = deque(maxlen=BIAS_DOUBTS_MAX)
        self._seen: Counter[tuple[str, str]] = Counter()

    @property
    def is_ready(self) -> bool:
        """The gyro bias is known; poses count from here."""
        return self._is_ready

    @property
    def pose(self) -> Pose2:
        """odom_from_base at the last wheel sample."""
        return self._pose

    @property
    def twist(self) -> VelocityCommand:
        """Velocity of the base, in the base frame."""
        return self._twist

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) over x_m, y_m, heading_rad of `pose`, since the start."""
        return self._kalman.covariance[State.POSE, State.POSE].copy()

    @property
    def gyro_bias_radps(self) -> float:
        """The bias as estimated now."""
        return float(self._kalman.state[State.GYRO_BIAS])

    @property
    def gyro_bias_std_radps(self) -> float:
        """Standard deviation of `gyro_bias_radps`."""
        return math.sqrt(float(self._kalman.covariance[State.GYRO_BIAS, State.GYRO_BIAS]))

    @property
    def is_slipping(self) -> bool:
        """The last wheel sample disagreed with the gyro."""
        return self._is_slipping

    @property
    def is_at_rest(self) -> bool:
        """The encoders have not moved for half a second."""
        return self._stamp_s - self._rest_since_s >= REST_AFTER_S

    @property
    def verdicts(self) -> dict[str, int]:
        """How often each verdict fell: `gyro.accepted`, `wheels.slip`, `compass.norm` ..."""
        counts = {f"{source}.{verdict}": n for (source, verdict), n in self._seen.items()}
        if self._standstill.refusals:
            counts["bias.refused"] = self._standstill.refusals
        return counts

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) odom_from_base at stamps (N,); see `PoseHistory.poses_at`."""
        return self._history.poses_at(stamps_s, self._twist)

    def increment(self, from_s: float, to_s: float) -> MotionIncrement:
        """Motion between two stamps, in the base frame at the first; see `PoseHistory`."""
        doubts = [BiasDoubt(from_s, to_s, self.gyro_bias_std_radps)]
        doubts += [doubt for doubt in self._bias_doubts if from_s < doubt.at_s <= to_s]
        return self._history.increment(from_s, to_s, self._twist, doubts)

    def on_imu(self, sample: ImuSample) -> Verdict:
        """Take a gyro reading, and the field that may come with it."""
        verdict = self._judge_rate(sample.stamp_s, sample.yaw_rate_radps)
        self._seen["gyro", verdict] += 1
        if verdict is Verdict.ACCEPTED:
            self._gyro.add(sample.stamp_s, sample.yaw_rate_radps)
            if not self._is_ready:
                verdict = self._calibrate(sample)
        if sample.field_gauss is not None and verdict is not Verdict.STALE:
            self._on_field(sample.field_gauss, sample.stamp_s)
        return verdict

    def on_wheels(self, sample: WheelSample) -> Verdict:
        """Take a telemetry frame: one step of the filter."""
        last = self._wheels
        if last is not None and (
            sample.stamp_s < last.stamp_s or sample.device_s == last.device_s
        ):
            verdict = Verdict.STALE
        elif last is None:
            verdict = self._refer_to(sample, 0.0)
        elif sample.device_s < last.device_s:
            verdict = self._refer_to(sample, sample.stamp_s - last.stamp_s)
        else:
            verdict = self._step(last, sample)
        self._seen["wheels", verdict] += 1
        return verdict

    def _judge_rate(self, stamp_s: float, rate_radps: float) -> Verdict:
        """A jump must be confirmed by the next reading before it is believed."""
        if not abs(rate_radps) <= GYRO_MAX_RADPS:  # also NaN
            return Verdict.IMPLAUSIBLE
        if stamp_s <= self._imu_stamp_s:
            return Verdict.STALE
        is_jump = abs(rate_radps - self._rate_radps) > GYRO_JUMP_MAX_RADPS
        doubtful, self._doubtful_radps = self._doubtful_radps, None
        if is_jump and math.isfinite(self._imu_stamp_s):
            is_confirmed = doubtful is not None and (
                abs(rate_radps - doubtful) <= GYRO_JUMP_MAX_RADPS
            )
            if not is_confirmed:
                self._doubtful_radps = rate_radps
                return Verdict.IMPLAUSIBLE
        self._imu_stamp_s, self._rate_radps = stamp_s, rate_radps
        return Verdict.ACCEPTED

    def _calibrate(self, sample: ImuSample) -> Verdict:
        if self._wheels is None:
            return Verdict.CALIBRATING  # whether it stands, only the encoders know
        bias = self._standstill.add(sample.stamp_s, sample.yaw_rate_radps)
        if bias is not None:
            self._begin(bias)
        return Verdict.CALIBRATING

    def _begin(self, bias: GyroBias) -> None:
        self._kalman.reset(
            gyro_bias_radps=bias.bias_radps,
            gyro_bias_std_radps=max(bias.std_radps, BIAS_STD_MIN_RADPS),
        )
        self._last_bias_radps = bias.bias_radps
        self._is_ready = True

    def _refer_to(self, sample: WheelSample, gap_s: float) -> Verdict:
        """Count from `sample`; a gap is bridged at the last velocity, growing uncertain."""
        stamp_s = max(sample.stamp_s, self._stamp_s + STAMP_STEP_MIN_S)
        is_first, self._wheels = self._wheels is None, sample
        self._implausible_wheels = 0
        self._rest_counts, self._rest_since_s = sample.counts, stamp_s
        if gap_s > 0.0:
            gyro_radps = self._gyro.mean_rate_radps(stamp_s, gap_s)
            if self._is_ready:
                self._kalman.predict(gap_s)
                if gyro_radps is not None:
                    self._kalman.update_gyro(gyro_radps, self._config.gyro_std_radps)
        speed_mps = math.hypot(self._twist.vx_mps, self._twist.vy_mps)
        self._keep(stamp_s, position_var=(speed_mps * gap_s) ** 2, heading_var=0.0)
        return Verdict.CALIBRATING if is_first else Verdict.RESTARTED

    def _step(self, last: WheelSample, sample: WheelSample) -> Verdict:
        dt_s = sample.device_s - last.device_s
        a, b, c = (new - old for new, old in zip(sample.counts, last.counts, strict=True))
        if max(abs(a), abs(b), abs(c)) > self._counts_per_s_max * dt_s + 2 * REST_COUNTS:
            self._implausible_wheels += 1
            if self._implausible_wheels < IMPLAUSIBLE_MAX:
                return Verdict.IMPLAUSIBLE
            return self._refer_to(sample, dt_s)
        self._implausible_wheels = 0
        self._wheels = sample
        stamp_s = max(sample.stamp_s, self._stamp_s + STAMP_STEP_MIN_S)
        gyro_radps = self._gyro.mean_rate_radps(stamp_s, dt_s)
        self._watch_rest(stamp_s, sample.counts)
        if not self._is_ready:
            self._keep(stamp_s, position_var=0.0, heading_var=0.0)
            return Verdict.CALIBRATING
        vx, vy, omega = self._kinematics.twist_from_counts((a, b, c), dt_s)
        noise = self._noise(stamp_s, omega, gyro_radps)
        self._watch_bias(stamp_s, dt_s, omega, gyro_radps, noise)
        self._kalman.predict(dt_s)
        is_plausible = self._kalman.update_wheels(vx, vy, omega, noise, gyro_radps)
        self._way_m += math.hypot(vx, vy) * dt_s
        self._keep_step(stamp_s, dt_s, noise, gyro_radps is not None)
        if self._is_slipping:
            return Verdict.SLIP
        return Verdict.ACCEPTED if is_plausible else Verdict.SURPRISING

    def _watch_rest(self, stamp_s: float, counts: tuple[int, int, int]) -> None:
        a, b, c = self._rest_counts
        moved = max(abs(counts[0] - a), abs(counts[1] - b), abs(counts[2] - c))
        if moved > REST_COUNTS:
            self._rest_counts, self._rest_since_s = counts, stamp_s
            if not self._is_ready:
                self._standstill.restart()
                self._compass = CompassGate(self._imu_config)

    def _watch_bias(
        self,
        stamp_s: float,
        dt_s: float,
        omega: float,
        gyro_radps: float | None,
        noise: MotionNoise,
    ) -> None:
        """Whether the bias has stepped by more than the filter can believe.

        When on the way it did is not known: any of it may be off by all of the step.
        """
        if gyro_radps is None or self._is_slipping:
            self._bias_watch.interrupted()
        elif not noise.is_at_rest:
            self._last_bias_radps = self.gyro_bias_radps
            off_radps = gyro_radps - self._last_bias_radps - omega
            suspected_radps = self._bias_watch.on_the_way(off_radps, dt_s)
            if suspected_radps is not None:
                self._bias_doubts.append(BiasDoubt(stamp_s, math.inf, abs(suspected_radps)))
        else:
            heard_radps = self._bias_watch.at_rest(gyro_radps, dt_s)
            if heard_radps is None:
                return
            # the first of a rest against the way, later ones against the last: no slow drift
            off_radps = heard_radps - self._last_bias_radps
            self._last_bias_radps = heard_radps
            if abs(off_radps) >= STEP_MIN_RADPS:
                self._kalman.set_bias(heard_radps, BIAS_STEP_STD_RADPS)
                since_s = self._rest_since_s
                self._bias_doubts.append(BiasDoubt(since_s, since_s, abs(off_radps)))
                self._seen["bias", "stepped"] += 1

    def _noise(self, stamp_s: float, omega: float, gyro_radps: float | None) -> MotionNoise:
        """How far this interval's wheels and gyro are to be believed."""
        config = self._config
        off_radps = 0.0
        if gyro_radps is not None:
            off_radps = abs(omega - (gyro_radps - float(self._kalman.state[State.GYRO_BIAS])))
        self._is_slipping = off_radps > config.slip_gate_radps
        if self._is_slipping:
            self._slip_steps += 1
            return MotionNoise(
                wheel_std_mps=config.wheel_std_mps * config.slip_inflation,
                wheel_yaw_std_radps=config.wheel_yaw_std_radps * config.slip_inflation,
                gyro_std_radps=config.gyro_std_radps,
            )
        self._slip_steps = 0
        if stamp_s - self._rest_since_s >= REST_AFTER_S and off_radps < REST_GYRO_RADPS:
            return MotionNoise(
                wheel_std_mps=REST_STD_MPS,
                wheel_yaw_std_radps=REST_STD_RADPS,
                gyro_std_radps=config.gyro_std_radps,
                is_at_rest=True,
            )
        return MotionNoise(
            wheel_std_mps=config.wheel_std_mps,
            wheel_yaw_std_radps=config.wheel_yaw_std_radps,
            gyro_std_radps=config.gyro_std_radps,
        )

    def _keep_step(
        self, stamp_s: float, dt_s: float, noise: MotionNoise, has_gyro: bool
    ) -> None:
        """Publish the new state, with what this step added to the doubt about the way."""
        config = self._config
        vx, vy, omega = self._kalman.state[State.TWIST].tolist()
        self._twist = VelocityCommand(vx_mps=vx, vy_mps=vy, yaw_rate_radps=omega)
        # Slip goes on in one direction: the n-th of a row adds (2n - 1) shares, n^2 in all.
        persistence = max(1, 2 * self._slip_steps - 1)
        position_var = persistence * (noise.wheel_std_mps * dt_s) ** 2
        position_var += config.odometry_std_per_m**2 * math.hypot(vx, vy) * dt_s
        yaw_var = noise.wheel_yaw_std_radps**2
        if has_gyro:
            yaw_var = 1.0 / (1.0 / yaw_var + 1.0 / noise.gyro_std_radps**2)
        heading_var = yaw_var * dt_s**2 + config.heading_std_per_rad**2 * abs(omega) * dt_s
        relies_on_bias = has_gyro and noise.wheel_yaw_std_radps > noise.gyro_std_radps
        self._keep(
            stamp_s,
            position_var=position_var,
            heading_var=heading_var,
            gyro_time_s=dt_s if relies_on_bias else 0.0,
        )

    def _keep(
        self,
        stamp_s: float,
        *,
        position_var: float,
        heading_var: float,
        gyro_time_s: float = 0.0,
    ) -> None:
        x, y, heading = self._kalman.state[State.POSE].tolist()
        self._pose = Pose2(x, y, wrap_rad(heading))
        has_rested_s = stamp_s - self._rest_since_s
        # Standing for minutes, only whole seconds are kept; the row in between is replaced.
        is_thinned = has_rested_s > LONG_REST_S and int(has_rested_s) == int(
            self._stamp_s - self._rest_since_s
        )
        self._history.append(
            stamp_s,
            (x, y, heading),
            position_var=position_var,
            heading_var=heading_var,
            gyro_time_s=gyro_time_s,
            replaces_last=is_thinned,
        )
        self._stamp_s = stamp_s

    def _on_field(self, field_gauss: tuple[float, float, float], stamp_s: float) -> None:
        """Judge a field; after each stretch, let its mean bearing correct the heading."""
        state = self._kalman.state
        if not self._is_ready:
            self._seen["compass", self._compass.learn(field_gauss)] += 1
            return
        ahead_s = min(max(stamp_s - self._stamp_s, 0.0), EXTRAPOLATE_MAX_S)
        heading_rad = float(state[State.HEADING]) + ahead_s * float(state[State.YAW_RATE])
        self._seen["compass", self._compass.judge(field_gauss, heading_rad)] += 1
        if self._way_m < self._config.compass_spacing_m:
            return
        bearing_rad = self._compass.bearing_rad
        self._compass.begin_stretch()
        self._way_m = 0.0
        if bearing_rad is not None:
            self._kalman.update_compass(
                bearing_rad - float(state[State.HEADING]),
                math.radians(self._config.compass_std_deg),
            )
