# SPDX-License-Identifier: MIT
"""What must be known to use gyro and compass: bias, field, and when to believe them.

In go gyro rates at standstill and magnetic fields; out come the bias with its uncertainty, and
for each field a verdict and how far the compass is off the filter's heading. Indoors a compass
errs by 10 to 40 degrees near metal, by the same amount as long as the robot stays where it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from ins_robot.config import ImuConfig
from ins_robot.geometry.angles import wrap_rad

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
    LEARNT = "learnt"  # it became the reference
    NORM = "norm"  # metal near: the field is stronger or weaker than at the start
    STEEP = "steep"  # nearly vertical: no heading in it
    DISAGREES = "disagrees"  # the field turned, the gyro did not


class CompassGate:
    """Compares the compass with the heading of the filter, and forgets what cannot be true.

    The reference (direction and norm of the field at heading 0 of `odom`) is the mean of the
    fields given to `learn`, or else the first one judged.
    """

    def __init__(self, config: ImuConfig) -> None:
        self._tolerance = config.field_tolerance
        self._disagreement_rad = math.radians(config.disagreement_deg)
        self._learnt = 0
        self._field = (0.0, 0.0, 0.0)
        self._direction_rad = 0.0
        self._norm_gauss = 0.0
        self._last_deviation_rad = 0.0
        self._last_variance = 0.0

    @property
    def has_reference(self) -> bool:
        """A field at a known heading has been seen."""
        return self._learnt > 0

    def learn(
        self, field_gauss: tuple[float, float, float], heading_rad: float
    ) -> FieldVerdict:
        """Average a field, seen at a known heading of the base, into the reference."""
        if _is_steep(field_gauss):
            return FieldVerdict.STEEP
        x, y, z = field_gauss
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        level = (c * x - s * y, s * x + c * y, z)  # in odom axes
        self._learnt += 1
        share = 1.0 / self._learnt
        a, b, d = (
            old + share * (new - old) for old, new in zip(self._field, level, strict=True)
        )
        self._field = (a, b, d)
        self._direction_rad = math.atan2(b, a)
        self._norm_gauss = math.hypot(a, b, d)
        return FieldVerdict.LEARNT

    def judge(
        self, field_gauss: tuple[float, float, float], heading_rad: float, heading_var: float
    ) -> tuple[FieldVerdict, float]:
        """Verdict, and compass heading minus `heading_rad` (meaningful when ACCEPTED).

        `heading_var` is the filter's variance of `heading_rad`: how far gyro and compass may
        have parted since the last accepted reading without either being wrong.
        """
        if not self.has_reference:
            return self.learn(field_gauss, heading_rad), 0.0
        x, y, z = field_gauss
        if abs(math.hypot(x, y, z) - self._norm_gauss) > self._tolerance * self._norm_gauss:
            return FieldVerdict.NORM, 0.0
        if _is_steep(field_gauss):
            return FieldVerdict.STEEP, 0.0
        deviation_rad = wrap_rad(self._direction_rad - math.atan2(y, x) - heading_rad)
        grown = math.sqrt(max(0.0, heading_var - self._last_variance))
        parted_rad = abs(wrap_rad(deviation_rad - self._last_deviation_rad))
        if parted_rad > self._disagreement_rad + 2.0 * grown:
            return FieldVerdict.DISAGREES, deviation_rad
        self._last_deviation_rad = deviation_rad
        self._last_variance = heading_var
        return FieldVerdict.ACCEPTED, deviation_rad


def _is_steep(field_gauss: tuple[float, float, float]) -> bool:
    return math.hypot(field_gauss[0], field_gauss[1]) < HORIZONTAL_MIN_GAUSS
