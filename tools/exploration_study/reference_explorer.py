# SPDX-License-Identifier: MIT
"""The explorer's gap strategies in the world of the published baselines.

The explorer is given that world's grid and 720 readings all around; where it wants to scan, the
reference robot goes by its own ground and way.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from exploration_study.reference_grid import (
    CELL_M,
    FREE,
    OCCUPIED,
    RANGE_M,
    RAYS,
    UNKNOWN,
    Cell,
    ReferenceGrid,
)
from ins_robot.config import ExplorationConfig, LrfConfig, MapConfig, RobotConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.mapping.scan_footprint import ScanFootprint
from ins_robot.messages import LaserScan
from ins_robot.navigation.explorer import Explorer, Finished
from ins_robot.navigation.outlook import Aim, Outlook

BODY_M = 0.12
"""Clearance to a wall's face, not to the centre of its cell: the discs of 0.2 m there."""
REFUSALS_MAX = 50


class GapsOnReferenceGrid:
    """A strategy for the reference robot that asks the explorer."""

    replan_m = math.inf

    def __init__(self, name: str, world: ReferenceGrid) -> None:
        self.name = name
        lrf = LrfConfig(sector_deg=180.0, range_max_m=RANGE_M, range_trusted_m=RANGE_M)
        config = ExplorationConfig(strategy=name)
        self._explorer = Explorer(config, RobotConfig(radius_m=BODY_M), lrf)
        self._grid = OccupancyGrid(CELL_M, MapConfig())
        self._world = world
        self._drawn = np.zeros_like(world.truth)

    def aim_from(
        self, cell: Cell, known: NDArray[np.uint8], corner: Cell, outlook: Outlook
    ) -> Aim | None:
        """The explorer's next place, if the reference robot can get there."""
        pose = Pose2((cell[1] + 0.5) * CELL_M, (cell[0] + 0.5) * CELL_M, 0.0)
        self._draw(known)
        number = len(self._explorer.graph)
        scan = self._scan(cell)
        self._explorer.observe(number, float(number), pose, scan, (0.0, math.pi))
        for _ in range(REFUSALS_MAX):
            decision = self._explorer.decide(pose, self._grid)
            if isinstance(decision, Finished):
                return None
            col, row = np.floor(decision.path.points_m[-1] / CELL_M).astype(int)
            place = (int(row) - corner[0], int(col) - corner[1])
            if math.isfinite(outlook.cost_m[place]):
                return Aim(
                    cell=place, targets=_nearest_edge(outlook, place), why=decision.reason
                )
            self._explorer.report_failure(decision, "no way on the reference robot's ground")
        return None

    def _draw(self, known: NDArray[np.uint8]) -> None:
        """Bring the explorer's map up to date."""
        is_new = (self._drawn == UNKNOWN) & (known != UNKNOWN)
        evidence = np.where(known == OCCUPIED, 3.0, -3.0).astype(np.float32) * is_new
        quiet = np.zeros(evidence.shape, bool)
        self._grid.add(ScanFootprint(corner=(0, 0), evidence=evidence, is_quiet=quiet))
        self._drawn = known.copy()

    def _scan(self, cell: Cell) -> LaserScan:
        bearings = 2.0 * np.pi * np.arange(RAYS) / RAYS - np.pi
        start = np.array([[cell[0] + 0.5, cell[1] + 0.5]])
        ranges = CELL_M * cast_rays(
            self._world.truth != FREE, start, bearings, RANGE_M / CELL_M
        )
        ranges[~np.isfinite(ranges)] = np.nan
        return LaserScan(
            stamp_s=0.0,
            bearings_rad=bearings,
            ranges_m=ranges,
            range_std_m=np.where(np.isfinite(ranges), 0.01, np.nan),
            beam_offsets_s=np.zeros(RAYS),
            range_max_m=RANGE_M,
        )


def _nearest_edge(outlook: Outlook, place: Cell) -> NDArray[np.int64]:
    """(1, 2) the edge cell nearest to a place; the place itself where there is no edge."""
    if not outlook.edges:
        return np.array([place])
    cells = np.concatenate(outlook.edges)
    away = cells - np.array(place)
    return cells[int((away**2).sum(axis=1).argmin())][None]
