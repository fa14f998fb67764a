# SPDX-License-Identifier: MIT
"""What must be known to use gyro and compass: bias, field, and when to believe them.

In go gyro rates at standstill and magnetic fields; out come the bias with its uncertainty, and
for each stretch of the way the bearing of the field, if it is to be believed. Indoors a compass
errs by 10 to 40 degrees near metal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from ins_robot.config import ImuConfig
from ins_robot.geometry.angles import wrap_rad

Field = tuple[float, float, float]

BIAS_MAX_RADPS = math.radians(25.0)  # MPU-6050: +-20 deg/s; more than that is a turn
SAMPLES_MIN = 10
HORIZONTAL_MIN_GAUSS = 0.04  # steeper than this near a magnetic pole there is no heading


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroBias:
    """Mean rate at standstill and the standard deviation of that mean."""

    bias_radps: float
    std_radps: float


class StandstillBias:
    """Averages the gyro for `bias_time_s`; begins again when the spread is no standstill."""

    def __init__(self, config: ImuConfig) -> None:
        self._time_s = config.bias_time_s
        self._std_max_radps = math.radians(config.bias_std_max_dps)
        self.refusals = 0
        self.restart()

    def restart(self) -> None:
        """Forget what was gathered."""
        self._since_s = math.nan
        self._count = 0
        self._mean = 0.0
        self._square_sum = 0.0

    def add(self, stamp_s: float, rate_radps: float) -> GyroBias | None:
        """Take one rate; the bias once there is enough, all of it standing still."""
        if self._count == 0:
            self._since_s = stamp_s
        # Welford's recurrence: mean and squared deviations without cancellation.
        self._count += 1
        off = rate_radps - self._mean
        self._mean += off / self._count
        self._square_sum += off * (rate_radps - self._mean)
        if stamp_s - self._since_s < self._time_s or self._count < SAMPLES_MIN:
            return None
        std = math.sqrt(self._square_sum / (self._count - 1))
        bias = GyroBias(bias_radps=self._mean, std_radps=std / math.sqrt(self._count))
        self.restart()
        if std > self._std_max_radps or abs(bias.bias_radps) > BIAS_MAX_RADPS:
            self.refusals += 1
            return None
        return bias


class FieldVerdict(StrEnum):
    """What became of a compass reading."""

    ACCEPTED = "accepted"
    LEARNT = "learnt"  # it went into the reference
    IMPLAUSIBLE = "implausible"  # not a number
    NORM = "norm"  # metal near: the field is stronger or weaker than at the start
    STEEP = "steep"  # nearly vertical: no heading in it
    DISAGREES = "disagrees"  # the field turned over this stretch, the gyro did not


class CompassGate:
    """Judges each field, and boils a stretch of the way down to one bearing of the field.

    Near metal the error of a compass is the same for as long as the robot stays, and changes as
    it drives by. So a stretch over which field and gyro turned alike counts as one reading, and
    one over which they did not counts as none.
    """

    def __init__(self, config: ImuConfig) -> None:
        self._tolerance = config.field_tolerance
        self._disagreement_rad = math.radians(config.disagreement_deg)
        self._learnt = 0
        self._norm_gauss = 0.0
        self.begin_stretch()

    def begin_stretch(self) -> None:
        """What comes now is another place."""
        self._first_rad: float | None = None
        self._off_sum_rad = 0.0
        self._count = 0
        self._has_disagreed = False

    @property
    def bearing_rad(self) -> float | None:
        """Mean bearing of the field in `odom` over the stretch; None: not to be used."""
        if self._first_rad is None or self._has_disagreed:
            return None
        return wrap_rad(self._first_rad + self._off_sum_rad / self._count)

    def learn(self, field_gauss: Field) -> FieldVerdict:
        """Average a field, seen standing at the start, into the reference norm."""
        if not all(map(math.isfinite, field_gauss)):
            return FieldVerdict.IMPLAUSIBLE
        self._learnt += 1
        self._norm_gauss += (math.hypot(*field_gauss) - self._norm_gauss) / self._learnt
        return FieldVerdict.LEARNT

    def judge(self, field_gauss: Field, heading_rad: float) -> FieldVerdict:
        """Take a field seen at `heading_rad` of the filter."""
        if self._learnt == 0:
            return self.learn(field_gauss)
        x, y, z = field_gauss
        off_gauss = abs(math.hypot(x, y, z) - self._norm_gauss)
        if not off_gauss <= self._tolerance * self._norm_gauss:  # so that NaN fails
            is_number = all(map(math.isfinite, field_gauss))
            return FieldVerdict.NORM if is_number else FieldVerdict.IMPLAUSIBLE
        if math.hypot(x, y) < HORIZONTAL_MIN_GAUSS:
            return FieldVerdict.STEEP
        bearing_rad = heading_rad + math.atan2(y, x)
        if self._first_rad is None:
            self._first_rad = bearing_rad
        off_rad = wrap_rad(bearing_rad - self._first_rad)
        if abs(off_rad) > self._disagreement_rad:
            self._has_disagreed = True
            return FieldVerdict.DISAGREES
        self._off_sum_rad += off_rad
        self._count += 1
        return FieldVerdict.ACCEPTED
