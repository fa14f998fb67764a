# SPDX-License-Identifier: MIT
"""What the odometry is worth on this floor: corrections by scans in, drift per metre out."""

from __future__ import annotations

import math

WAY_MIN_M = 0.3  # after less the scan's own error is what shows
LOOKS_MIN = 8


class DriftMeter:
    """Root mean square of how far the pose was off, for the way driven since the last scan."""

    def __init__(self) -> None:
        self._looks = 0
        self._off2_m2 = self._way2_m2 = 0.0

    def corrected(self, off_m: float, way_m: float) -> None:
        """A scan moved the pose by `off_m`, `way_m` after the last one."""
        if way_m < WAY_MIN_M:
            return
        self._looks += 1
        self._off2_m2 += off_m**2
        self._way2_m2 += way_m**2

    @property
    def per_m(self) -> float:
        """Metres per metre; 0 while too little has been driven to tell."""
        return math.sqrt(self._off2_m2 / self._way2_m2) if self._looks >= LOOKS_MIN else 0.0
