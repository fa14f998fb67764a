# SPDX-License-Identifier: MIT
"""Where the robot may be and what it need not explore: boundary, radius, zones; masks out.

The body stays inside the boundary and out of no-go zones, and does not cross virtual walls: its
centre keeps its radius and the planning clearance from their lines. The radius about the start
is for the centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import ExplorationConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.polygon import contains, outline_m
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.navigation.gaps import GapState
from ins_robot.navigation.limit_lines import LimitLine
from ins_robot.navigation.room_map import RoomMap

BoolArray = NDArray[np.bool_]
ASTRIDE_M = 0.08  # so near to a line, in cells the robot stands on it
FENCE_REACH_M = 30.0  # further away a line is the planner's affair, not yet the guard's
CIRCLE_SIDES = 72
ESCAPE_M = 0.3  # a robot standing on forbidden ground may cross so much more of it to get off


class Bounds:
    """The limits of one run; zones may change. The centre keeps `keep_m` from their lines."""

    def __init__(
        self, config: ExplorationConfig, keep_m: float, zones: tuple[Zone, ...] = ()
    ) -> None:
        self._config, self._keep_m = config, keep_m
        self._radius_m = config.max_radius_m
        self._boundary = None if config.boundary is None else np.array(config.boundary)
        self.zones = zones

    @property
    def zones(self) -> tuple[Zone, ...]:
        """The no-go zones and virtual walls."""
        return self._zones

    @zones.setter
    def zones(self, zones: tuple[Zone, ...]) -> None:
        self._zones = zones
        self._lines = [LimitLine.of_zone(zone) for zone in zones]
        if self._config.boundary is not None:
            self._lines.append(LimitLine.around(self._config.boundary))
        self._no_go = [
            (f"in no-go zone '{zone.name}'", np.array(zone.points_m))
            for zone in zones
            if zone.kind is ZoneKind.NO_GO
        ]
        self._room = RoomMap(self._lines, self._keep_m)

    @property
    def are_open(self) -> bool:
        """Nothing is forbidden."""
        return self._radius_m <= 0.0 and not self._lines

    def outlines_m(self, start: Pose2) -> list[FloatArray]:
        """Closed lines (N, 2) around where the robot may be, of boundary and radius."""
        outlines = [] if self._boundary is None else [outline_m(self._boundary)]
        if self._radius_m > 0.0:
            turns_rad = np.linspace(0.0, 2.0 * np.pi, CIRCLE_SIDES + 1)
            around = np.stack([np.cos(turns_rad), np.sin(turns_rad)], axis=-1)
            outlines.append(np.array([start.x_m, start.y_m]) + self._radius_m * around)
        return outlines

    def without_zones(self) -> Bounds:
        """The same without no-go zones and virtual walls."""
        return Bounds(self._config, self._keep_m)

    def refusal(self, start: Pose2, point_m: FloatArray) -> tuple[GapState, str] | None:
        """Why a point (2,) is none of the robot's business; None: it is."""
        return self.refusals(start, point_m[None])[0]

    def refusals(self, start: Pose2, points_m: FloatArray) -> list[tuple[GapState, str] | None]:
        """The same of points (N, 2)."""
        found: list[tuple[GapState, str] | None] = [None] * len(points_m)

        def refuse(which: BoolArray, state: GapState, why: str) -> None:
            for index in np.flatnonzero(which):  # the first reason is told
                found[index] = found[index] or (state, why)

        if self._radius_m > 0.0:
            away_m = np.hypot(points_m[:, 0] - start.x_m, points_m[:, 1] - start.y_m)
            why = f"outside max_radius_m = {self._radius_m:g}"
            refuse(away_m > self._radius_m, GapState.OUTSIDE, why)
        if self._boundary is not None:
            is_out = ~contains(self._boundary, points_m)
            refuse(is_out, GapState.OUTSIDE, "outside the boundary")
        for why, corners_m in self._no_go:
            refuse(contains(corners_m, points_m), GapState.NO_GO, why)
        return found

    def masks(
        self, start: Pose2, pose: Pose2, grid: OccupancyGrid
    ) -> tuple[BoolArray | None, BoolArray | None]:
        """Drivable and wanted cells of a grid, for a robot now at `pose`."""
        return self.drivable_cells(start, grid, pose), self.wanted_cells(start, grid)

    def wanted_cells(self, start: Pose2, grid: OccupancyGrid) -> BoolArray | None:
        """(H, W) bool: cells worth exploring; None: everywhere."""
        if self.are_open:
            return None
        return self._is_near(start, grid, self._room.on(grid) >= 0.0)

    def drivable_cells(
        self, start: Pose2, grid: OccupancyGrid, pose: Pose2
    ) -> BoolArray | None:
        """(H, W) bool: cells where the centre of a robot now at `pose` may be; None: all.

        A robot that stands where it must not may leave by ground that is no deeper in.
        """
        if self.are_open:
            return None
        ok = self._is_near(start, grid, self._room.on(grid) >= self._keep_m)
        row, col = (int(v) for v in grid.cells(np.array([pose.x_m, pose.y_m])))
        height, width = ok.shape
        if 0 <= row < height and 0 <= col < width and not ok[row, col]:
            room = self._room_m(start, grid)
            lack_m = self._keep_m - float(room[row, col]) + ESCAPE_M
            rows, cols = np.ogrid[:height, :width]
            near = np.hypot(rows - row, cols - col) * grid.resolution_m <= lack_m
            ok |= near & (room >= room[row, col] - 0.5 * grid.resolution_m)
        return ok

    def fence_m(self, pose: Pose2) -> FloatArray:
        """(N, 2) points along all lines around, for those who know obstacles as points.

        A robot that stands beyond a line or on it, at `pose`, may leave: the line has no points
        as far around as `drivable_cells` lets it go.
        """
        here = np.array([[pose.x_m, pose.y_m]])
        pieces = [np.zeros((0, 2))]
        for line in self._lines:
            points = line.fence_m(here[0] - FENCE_REACH_M, here[0] + FENCE_REACH_M)
            room_m = float(line.room_m(here)[0])
            if room_m < ASTRIDE_M:
                way_m = self._keep_m - room_m + ESCAPE_M
                points = points[np.hypot(*(points - here).T) > way_m + self._keep_m]
            pieces.append(points)
        return np.concatenate(pieces)

    def _is_near(self, start: Pose2, grid: OccupancyGrid, cells: BoolArray) -> BoolArray:
        """(H, W) bool: of cells, those within the radius."""
        if self._radius_m <= 0.0:
            return cells
        x, y = _from_start_m(start, grid)
        return np.asarray(cells & (x**2 + y**2 <= self._radius_m**2))

    def _room_m(self, start: Pose2, grid: OccupancyGrid) -> FloatArray:
        """(H, W) from cells to the nearest limit, negative beyond; `keep_m` off the radius."""
        room = self._room.on(grid)
        if self._radius_m <= 0.0:
            return room
        x, y = _from_start_m(start, grid)
        return np.minimum(room, self._radius_m + self._keep_m - np.hypot(x, y))


def _from_start_m(start: Pose2, grid: OccupancyGrid) -> tuple[FloatArray, FloatArray]:
    """Metres from the start to cells: x (1, W) and y (H, 1)."""
    height, width = grid.shape
    x = grid.metres(np.stack([np.zeros(width, np.int64), np.arange(width)], axis=-1))[:, 0]
    y = grid.metres(np.stack([np.arange(height), np.zeros(height, np.int64)], axis=-1))[:, 1]
    return x[None] - start.x_m, y[:, None] - start.y_m
