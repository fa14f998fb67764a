# SPDX-License-Identifier: MIT
"""A part of an occupancy grid, to look at as if it were all: a grid and its cells in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.kept_layer import Part
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.wall_distances import CLEARANCE_UP_TO_M

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


class GridWindow(OccupancyGrid):
    """Read-only; it copies nothing."""

    def __init__(self, grid: OccupancyGrid, part: Part) -> None:
        super().__init__(grid.resolution_m, grid.config)
        self._grid, self._part = grid, part
        self._corner = (grid.corner[0] + part[0].start, grid.corner[1] + part[1].start)
        self.log_odds, self.is_quiet = grid.log_odds[part], grid.is_quiet[part]
        self.log_odds.flags.writeable = self.is_quiet.flags.writeable = False

    def walls(self) -> cKDTree:
        """Those of its cells."""
        if self._walls is None:
            self._walls = self._grid.distances.walls_within(self._grid, self._part)
        return self._walls

    def walls_near(self, points_m: FloatArray) -> cKDTree:
        """Those of the whole grid."""
        return self._grid.walls_near(points_m)

    def clearance_m(self, up_to_m: float = CLEARANCE_UP_TO_M) -> FloatArray:
        """As the whole grid knows it."""
        return self._grid.distances.clearance_m(self._grid, self._part, up_to_m)

    def doubt_m(self, up_to_m: float = CLEARANCE_UP_TO_M) -> FloatArray:
        """As the whole grid knows it."""
        return self._grid.distances.doubt_m(self._grid, self._part, up_to_m)
