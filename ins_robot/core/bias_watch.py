# SPDX-License-Identifier: MIT
"""Steps of the gyro's bias: a chip that is knocked or warmed reads a turn that is none.

What the gyro reads goes in, at rest, and beyond the wheels, on the way. At rest two means that
agree tell by how much the bias has stepped. Wheels slip, and tell no more than a suspicion,
when seconds of driving differ more than they usually do.
"""

from __future__ import annotations

import math
from collections import deque

REST_S = 0.3
STEP_MIN_RADPS = 0.002  # smaller ones are the filter's affair
WAY_S = 3.0
USUAL_MIN, USUAL_MAX = 8, 60  # so many means over WAY_S tell what is usual
SUSPICIOUS_STDS = 2.5
SUSPICIOUS_MIN_RADPS = 0.015


class BiasWatch:
    """Watches one gyro."""

    def __init__(self) -> None:
        self._rest, self._rest_radps, self._way = _Mean(), math.inf, _Mean()
        self._usual: deque[float] = deque(maxlen=USUAL_MAX)

    def at_rest(self, gyro_radps: float, dt_s: float) -> float | None:
        """What the gyro reads, that is its bias; None: too little has been heard to tell."""
        self._way = _Mean()
        mean_radps = self._rest.over(REST_S, gyro_radps, dt_s)
        if mean_radps is None:
            return None
        last_radps, self._rest_radps = self._rest_radps, mean_radps
        return mean_radps if abs(mean_radps - last_radps) < STEP_MIN_RADPS else None

    def on_the_way(self, off_radps: float, dt_s: float) -> float | None:
        """Rad/s by which the bias may have stepped; None: no more than is usual."""
        self._end_rest()
        mean_radps = self._way.over(WAY_S, off_radps, dt_s)
        if mean_radps is None:
            return None
        usual_radps = math.sqrt(sum(mean**2 for mean in self._usual) / max(1, len(self._usual)))
        is_known = len(self._usual) >= USUAL_MIN
        most_radps = max(SUSPICIOUS_MIN_RADPS, SUSPICIOUS_STDS * usual_radps)
        # what is suspicious becomes usual only slowly, should the floor have changed
        self._usual.append(min(abs(mean_radps), most_radps))
        return mean_radps if is_known and abs(mean_radps) > most_radps else None

    def interrupted(self) -> None:
        """The wheels slip or the gyro is silent: nothing is to be held against anything."""
        self._way = _Mean()
        self._end_rest()

    def _end_rest(self) -> None:
        self._rest, self._rest_radps = _Mean(), math.inf


class _Mean:
    """The mean of a rate over a time, again and again."""

    def __init__(self) -> None:
        self._angle_rad = self._time_s = 0.0

    def over(self, time_s: float, rate_radps: float, dt_s: float) -> float | None:
        """With one more interval; None before the time is full."""
        self._angle_rad += rate_radps * dt_s
        self._time_s += dt_s
        if self._time_s < time_s:
            return None
        mean_radps = self._angle_rad / self._time_s
        self._angle_rad = self._time_s = 0.0
        return mean_radps
