# SPDX-License-Identifier: MIT
"""What the odometry is worth on this floor: corrections by scans in, drift out."""

from __future__ import annotations

import math
from collections import deque

WAY_MIN_M = 0.3  # after less the scan's own error is what shows
LOOKS_MIN = 8
LOOKS_MAX = 60  # the last so many: floors change, and a push by hand is forgotten


class DriftMeter:
    """Root mean square of how far the pose was off, over the ways since scans located it."""

    def __init__(self) -> None:
        self._since_m = 0.0
        self._looks: deque[tuple[float, float]] = deque(maxlen=LOOKS_MAX)  # off, way; squared

    def located(self, off_m: float, at_m: float) -> None:
        """A scan moved the pose by that much, `at_m` of the way driven."""
        way_m = at_m - self._since_m
        if way_m >= WAY_MIN_M:
            self._looks.append((off_m**2, way_m**2))
        self._since_m = at_m

    def interrupted(self, at_m: float) -> None:
        """The map moved: what the pose did says nothing about the way."""
        self._since_m = at_m

    @property
    def per_m(self) -> float:
        """Metres per metre; 0 while too little has been driven to tell."""
        if len(self._looks) < LOOKS_MIN:
            return 0.0
        off2_m2, way2_m2 = map(sum, zip(*tuple(self._looks), strict=True))
        return math.sqrt(off2_m2 / way2_m2)
