# SPDX-License-Identifier: MIT
"""Whether the LRF still shows anything: scans in, and when to drive no further out.

A covered LRF and the middle of a huge hall look alike, node scans without readings. A wall near
by in the map tells them apart: it should be seen.
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.silence import READINGS_MIN
from ins_robot.messages import LaserScan

SCANS_MAX = 4  # so many next to without readings in a row: covered, or lost in a huge hall
SCANS_BESIDE_WALLS_MAX = 2  # and where the map has a wall within the trusted range: covered


class Blindness:
    """Counts the node scans in a row that had hardly a reading."""

    def __init__(self, range_trusted_m: float) -> None:
        self._range_trusted_m = range_trusted_m
        self.scans = 0

    def scanned(self, scan: LaserScan) -> None:
        """A node scan was taken."""
        self.scans += 1
        self.glimpsed(scan)

    def glimpsed(self, scan: LaserScan) -> None:
        """A look, on the way too: whoever sees is not blind."""
        if np.count_nonzero(scan.is_valid) >= READINGS_MIN:
            self.scans = 0

    @property
    def is_feared(self) -> bool:
        """The last scans had hardly a reading; the LRF may be covered."""
        return self.scans >= SCANS_BESIDE_WALLS_MAX

    def is_sure(self, pose: Pose2, grid: OccupancyGrid) -> bool:
        """Whether nothing may be driven to from `pose` (map_from_base)."""
        if not self.is_feared:
            return False
        wall_m, _ = grid.walls().query((pose.x_m, pose.y_m))
        return self.scans >= SCANS_MAX or bool(wall_m <= self._range_trusted_m)

    @property
    def why(self) -> str:
        """For the operator."""
        return f"{self.scans} scans in a row without a reading: is the LRF covered?"
