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
from ins_robot.geometry.polygon import contains, distance_m, outline_m
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.navigation.gaps import GapState

BoolArray = NDArray[np.bool_]
ESCAPE_M = 0.3  # a robot standing on forbidden ground may cross so much more of it to get off
FENCE_STEP_M = 0.02  # spacing of the points that stand for a line


class Bounds:
    """The limits of one run; zones may change."""

    def __init__(self, config: ExplorationConfig, zones: tuple[Zone, ...] = ()) -> None:
        self._config = config
        self._radius_m = config.max_radius_m
        self._boundary = None if config.boundary is None else np.array(config.boundary)
        self._zones: tuple[Zone, ...] = ()
        self._room: tuple[tuple[object, ...], FloatArray] | None = None
        self.zones = zones

    @property
    def zones(self) -> tuple[Zone, ...]:
        """The no-go zones and virtual walls."""
        return self._zones

    @zones.setter
    def zones(self, zones: tuple[Zone, ...]) -> None:
        self._zones, self._room = zones, None

    @property
    def are_open(self) -> bool:
        """Nothing is forbidden."""
        return self._radius_m <= 0.0 and self._boundary is None and not self._zones

    def without_zones(self) -> Bounds:
        """The same without no-go zones and virtual walls."""
        return Bounds(self._config)

    def refusal(self, start: Pose2, point_m: FloatArray) -> tuple[GapState, str] | None:
        """Why a point (2,) is none of the robot's business; None: it is."""
        points = point_m[None]
        away_m = float(np.hypot(point_m[0] - start.x_m, point_m[1] - start.y_m))
        if 0.0 < self._radius_m < away_m:
            return GapState.OUTSIDE, f"outside max_radius_m = {self._radius_m:g}"
        if self._boundary is not None and not contains(self._boundary, points)[0]:
            return GapState.OUTSIDE, "outside the boundary"
        for zone in self._zones:
            if zone.kind is ZoneKind.NO_GO and contains(np.array(zone.points_m), points)[0]:
                return GapState.NO_GO, f"in no-go zone '{zone.name}'"
        return None

    def wanted_cells(self, start: Pose2, grid: OccupancyGrid) -> BoolArray | None:
        """(H, W) bool: cells worth exploring; None: everywhere."""
        if self.are_open:
            return None
        return self._room_m(start, grid, 0.0) >= 0.0

    def drivable_cells(
        self, start: Pose2, grid: OccupancyGrid, pose: Pose2, keep_m: float
    ) -> BoolArray | None:
        """(H, W) bool: cells where the centre of a robot now at `pose` may be; None: all.

        `keep_m` is what the centre keeps from lines. A robot that stands where it must not may
        leave by ground that is no deeper in.
        """
        if self.are_open:
            return None
        room = self._room_m(start, grid, keep_m)
        ok = room >= keep_m
        row, col = (int(v) for v in grid.cells(np.array([pose.x_m, pose.y_m])))
        height, width = ok.shape
        if 0 <= row < height and 0 <= col < width and not ok[row, col]:
            lack_m = keep_m - float(room[row, col]) + ESCAPE_M
            rows, cols = np.ogrid[:height, :width]
            near = np.hypot(rows - row, cols - col) * grid.resolution_m <= lack_m
            ok |= near & (room >= room[row, col] - 0.5 * grid.resolution_m)
        return np.asarray(ok)

    def fence_m(self) -> FloatArray:
        """(N, 2) points along all lines, for those who know obstacles as points."""
        lines = [np.array(zone.points_m) for zone in self._zones if zone.kind is ZoneKind.WALL]
        lines += [
            outline_m(np.array(zone.points_m))
            for zone in self._zones
            if zone.kind is ZoneKind.NO_GO
        ]
        if self._boundary is not None:
            lines.append(outline_m(self._boundary))
        return np.concatenate([np.zeros((0, 2)), *map(_points_along, lines)])

    def _room_m(self, start: Pose2, grid: OccupancyGrid, keep_m: float) -> FloatArray:
        """(H, W) from cells to the nearest limit, negative beyond; `keep_m` off the radius."""
        room = self._line_room_m(grid)
        if self._radius_m <= 0.0:
            return room
        low, high = grid.metres(np.array([[0, 0], [grid.shape[0] - 1, grid.shape[1] - 1]]))
        x = np.linspace(low[0], high[0], grid.shape[1]) - start.x_m
        y = np.linspace(low[1], high[1], grid.shape[0]) - start.y_m
        return np.minimum(room, self._radius_m - np.hypot(x[None, :], y[:, None]) + keep_m)

    def _line_room_m(self, grid: OccupancyGrid) -> FloatArray:
        """(H, W) from cells to the nearest forbidden line, negative beyond; kept."""
        key = (grid.origin_m, grid.shape, grid.resolution_m)
        if self._room is None or self._room[0] != key:
            room = np.full(grid.shape, np.inf)
            if self._boundary is not None or self._zones:
                cells = np.argwhere(np.ones(grid.shape, bool))
                room = self._room_of(grid.metres(cells)).reshape(grid.shape)
            self._room = (key, room)
        return self._room[1]

    def _room_of(self, points_m: FloatArray) -> FloatArray:
        room = np.full(len(points_m), np.inf)
        if self._boundary is not None:
            edge = distance_m(outline_m(self._boundary), points_m)
            room = np.where(contains(self._boundary, points_m), edge, -edge)
        for zone in self._zones:
            line = np.array(zone.points_m)
            if zone.kind is ZoneKind.NO_GO:
                edge = distance_m(outline_m(line), points_m)
                room = np.minimum(room, np.where(contains(line, points_m), -edge, edge))
            else:
                room = np.minimum(room, distance_m(line, points_m))
        return room


def _points_along(line_m: FloatArray) -> FloatArray:
    steps = np.hypot(*np.diff(line_m, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(0.0, along[-1] + FENCE_STEP_M, FENCE_STEP_M)
    return np.column_stack([np.interp(at, along, line_m[:, k]) for k in (0, 1)])
