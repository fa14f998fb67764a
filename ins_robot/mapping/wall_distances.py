# SPDX-License-Identifier: MIT
"""Distances on a grid: to walls, told by readings where somebody may drive, and to the unknown.

A grid and its changes in; points on walls, clearance and doubt of any part of it out. Only what
has changed is worked out again, and only where it is asked for.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.cell_states import CROSSED_LOG_ODDS, OCCUPIED_LOG_ODDS, solid, unknown
from ins_robot.mapping.kept_layer import Changes, KeptLayer, Part, part_of
from ins_robot.mapping.neighbourhood import grown, set_cells
from ins_robot.mapping.wall_points import NearReadings, wall_points

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from ins_robot.mapping.occupancy_grid import OccupancyGrid

CLEARANCE_UP_TO_M = 0.5  # told up to here, or as far as is asked
WALLS_NEAR_M = 1.0  # as far as `walls_near` is asked
EXACT_BELOW_M = 0.35  # clearance below this is told by readings, above it by cells
CORNERS = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]])


class WallDistances:
    """Those of one grid.

    Attributes
    ----------
    near : NearReadings
        What scans know of walls, finer than cells.
    changes : Changes
        Where the grid changed.
    """

    def __init__(self) -> None:
        self.near, self.changes = NearReadings(), Changes()
        self._clearance = KeptLayer(CLEARANCE_UP_TO_M, unknown=None)
        self._doubt = KeptLayer(CLEARANCE_UP_TO_M, unknown=0.0)

    def walls_near(self, grid: OccupancyGrid, points_m: FloatArray) -> cKDTree:
        """Those no farther than WALLS_NEAR_M from points (N, 2), and some more."""
        cells = grid.cells(points_m)
        reach = math.ceil(WALLS_NEAR_M / grid.resolution_m)
        low = np.clip(cells.min(axis=0) - reach, 0, grid.shape).tolist()
        high = np.clip(cells.max(axis=0) + reach + 1, 0, grid.shape).tolist()
        return self.walls_within(grid, (slice(low[0], high[0]), slice(low[1], high[1])))

    def walls_within(self, grid: OccupancyGrid, part: Part) -> cKDTree:
        """Points (N, 2) on what is solid in some cells, map frame."""
        from scipy.spatial import cKDTree

        low = np.array([part[0].start, part[1].start])
        odds = grid.log_odds[part]
        is_occupied = odds > OCCUPIED_LOG_ODDS
        first_m, last_m = (grid.metres(low + n * np.array(is_occupied.shape)) for n in (0, 1))
        points, ranges, counts = self.near.within(first_m, last_m)
        cells = grid.cells(points) - low
        drawn = ((cells >= 0) & (cells < is_occupied.shape)).all(axis=-1)
        seen, told = wall_points(
            points[drawn],
            ranges[drawn],
            counts[drawn],
            cells[drawn],
            is_occupied,
            odds < CROSSED_LOG_ODDS,
        )
        corners = grid.metres(set_cells(is_occupied & ~told) + low)[:, None] + (
            grid.resolution_m * CORNERS
        )
        is_hidden = solid(odds, grid.is_quiet[part]) & ~is_occupied & ~told
        hidden = grid.metres(set_cells(is_hidden) + low)
        points = np.concatenate([seen, corners.reshape(-1, 2), hidden])
        # built in half the time, and asked as fast: such points lie evenly
        return cKDTree(points, balanced_tree=False, compact_nodes=False)

    def clearance_m(self, grid: OccupancyGrid, part: Part, up_to_m: float) -> FloatArray:
        """As the grid tells it, of some cells."""
        return self._clearance.on(
            grid, self.changes, partial(self._clearance_of, grid), part, up_to_m
        )

    def doubt_m(self, grid: OccupancyGrid, part: Part, up_to_m: float) -> FloatArray:
        """As the grid tells it, of some cells."""
        return self._doubt.on(grid, self.changes, partial(self._doubt_of, grid), part, up_to_m)

    def _clearance_of(self, grid: OccupancyGrid, part: Part, around: Part) -> FloatArray:
        from scipy.ndimage import distance_transform_edt

        odds = grid.log_odds[around]
        is_solid = solid(odds, grid.is_quiet[around])
        inner = part_of(part, around)
        if not is_solid.any():
            return np.full(odds[inner].shape, np.inf)
        clearance = distance_transform_edt(~is_solid, sampling=grid.resolution_m)[inner]
        clearance -= 0.5 * grid.resolution_m
        asked = (clearance < EXACT_BELOW_M) & (clearance > 0.0)
        asked &= grid.is_quiet[part] | ~unknown(odds[inner])
        at = set_cells(asked)
        centres = grid.metres(at + np.array([part[0].start, part[1].start]))
        clearance[at[:, 0], at[:, 1]], _ = self.walls_within(grid, around).query(centres)
        return np.asarray(clearance)

    def _doubt_of(self, grid: OccupancyGrid, part: Part, around: Part) -> FloatArray:
        from scipy.ndimage import distance_transform_edt

        odds = grid.log_odds[around]
        is_doubtful = grown(unknown(odds), corners=False) & (odds <= OCCUPIED_LOG_ODDS)
        inner = part_of(part, around)
        if not is_doubtful.any():
            return np.full(odds[inner].shape, np.inf)
        doubt = distance_transform_edt(~is_doubtful, sampling=grid.resolution_m)
        return np.asarray(doubt[inner])

    def open_sides(self, grid: OccupancyGrid, low: list[int], high: list[int]) -> None:
        """Where the grid grows and known cells are near, the layers go on into what is new."""
        reach_m = max(self._clearance.reach_m, self._doubt.reach_m)
        reach = math.ceil(reach_m / grid.resolution_m) + 2
        for axis in (0, 1):
            odds = grid.log_odds if axis == 0 else grid.log_odds.T
            first, end = grid.corner[axis], grid.corner[axis] + len(odds)
            for line, band, is_grown in (
                (first, odds[:reach], low[axis] < first),
                (end - 1, odds[-reach:], high[axis] > end),
            ):
                known = np.flatnonzero((~unknown(band)).any(axis=0))
                if is_grown and len(known):
                    along = int(known[0]) + grid.corner[1 - axis]
                    corner, size = (line, along), (1, int(np.ptp(known)) + 1)
                    if axis == 1:
                        corner, size = (along, line), (size[1], 1)
                    self.changes.add(corner, size)
