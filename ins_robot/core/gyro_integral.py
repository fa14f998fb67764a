# SPDX-License-Identifier: MIT
"""The gyro's angle as a function of time, so that no turn is lost between two clocks.

Gyro and wheels tick at the same rate but not together. Averaging "the readings since the last
frame" loses a turn each time one falls on the other side; differences of one integral do not.
"""

from __future__ import annotations

HOLD_MAX_S = 0.1  # a reading older than this says nothing about now


class GyroIntegral:
    """Trapezoids between readings, the last rate held beyond the last one."""

    def __init__(self) -> None:
        self._stamp_s: float | None = None
        self._rate_radps = 0.0
        self._angle_rad = 0.0
        self._taken_rad: float | None = None

    def add(self, stamp_s: float, rate_radps: float) -> None:
        """Take a reading; stamps must increase."""
        if self._stamp_s is not None:
            gap_s = stamp_s - self._stamp_s
            if gap_s > HOLD_MAX_S:
                self._taken_rad = None  # what happened in the gap is not known
            self._angle_rad += 0.5 * gap_s * (self._rate_radps + rate_radps)
        self._stamp_s, self._rate_radps = stamp_s, rate_radps

    def mean_rate_radps(self, until_s: float, dt_s: float) -> float | None:
        """Angle since the last call divided by `dt_s`; None when readings are missing."""
        if self._stamp_s is None or until_s - self._stamp_s > HOLD_MAX_S:
            self._taken_rad = None
            return None
        angle_rad = self._angle_rad + self._rate_radps * (until_s - self._stamp_s)
        taken_rad, self._taken_rad = self._taken_rad, angle_rad
        return None if taken_rad is None else (angle_rad - taken_rad) / dt_s
