# SPDX-License-Identifier: MIT
"""How far a place is from the nearest wall: exact, to the wall's boundary.

Walls are whole cells, squares. `field_m` holds the distance from every cell's centre at once.
`nearest_wall` answers for any point in plain floats, about 3 us: for each cell it keeps the few
wall cells that can be nearest to some point of that cell, found when the cell is first entered.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ins_robot.geometry.angles import FloatArray

_HALF_DIAGONAL = math.sqrt(0.5)


class NearestWall(NamedTuple):
    """Distance to the nearest wall, and the nearest point of it, in metres, world frame."""

    distance_m: float
    x_m: float
    y_m: float


class Clearance:
    """Distances to the walls of one grid.

    Attributes
    ----------
    field_m : (H, W) float64
        From each cell's centre to the nearest wall's boundary; 0 in walls. Read-only.
    """

    def __init__(
        self, is_occupied: NDArray[np.bool_], resolution_m: float, origin_m: tuple[float, float]
    ) -> None:
        self._is_occupied = is_occupied
        self._resolution_m = resolution_m
        self._origin_m = origin_m
        self._candidates: dict[tuple[int, int], list[tuple[float, float]]] = {}
        self.field_m = _field_cells(is_occupied) * resolution_m
        self.field_m.flags.writeable = False
        self._field = memoryview(self.field_m)  # type: ignore[arg-type]  # numpy is a buffer
        self._height, self._width = is_occupied.shape

    def at_least_m(self, x_m: float, y_m: float) -> float:
        """A lower bound of the distance at a point, too low by a diagonal at most; cheap."""
        row = math.floor((y_m - self._origin_m[1]) / self._resolution_m)
        col = math.floor((x_m - self._origin_m[0]) / self._resolution_m)
        if not (0 <= row < self._height and 0 <= col < self._width):
            return 0.0
        return self._field[row, col] - _HALF_DIAGONAL * self._resolution_m

    def nearest_wall(self, x_m: float, y_m: float) -> NearestWall:
        """Exact distance from a point to the walls; 0 inside one or outside the grid."""
        scale = self._resolution_m
        across = (x_m - self._origin_m[0]) / scale
        up = (y_m - self._origin_m[1]) / scale
        row, col = math.floor(up), math.floor(across)
        if not (0 <= row < self._height and 0 <= col < self._width):
            return NearestWall(0.0, x_m, y_m)
        if (row, col) not in self._candidates:
            self._candidates[row, col] = self._wall_cells_near(row, col)
        nearest, wall_row, wall_col = math.inf, up, across
        for low_row, low_col in self._candidates[row, col]:
            r = min(max(up, low_row), low_row + 1.0)
            c = min(max(across, low_col), low_col + 1.0)
            squared = (up - r) * (up - r) + (across - c) * (across - c)
            if squared < nearest:
                nearest, wall_row, wall_col = squared, r, c
        return NearestWall(
            math.sqrt(nearest) * scale,
            self._origin_m[0] + wall_col * scale,
            self._origin_m[1] + wall_row * scale,
        )

    def _wall_cells_near(self, row: int, col: int) -> list[tuple[float, float]]:
        """Wall cells that can be the nearest one to some point of the cell (row, col)."""
        # A point of the cell is at most half a diagonal from its centre, so its nearest wall is
        # at most that much farther from the point, and once more that much from the centre.
        reach = self._field[row, col] / self._resolution_m + 2.0 * _HALF_DIAGONAL
        pad = math.ceil(reach) + 1
        low_row, low_col = max(0, row - pad), max(0, col - pad)
        window = self._is_occupied[low_row : row + pad + 1, low_col : col + pad + 1]
        cells = np.argwhere(window) + np.array((low_row, low_col))
        offset = np.maximum(np.abs(cells - np.array((row, col))) - 0.5, 0.0)
        near = cells[np.hypot(offset[:, 0], offset[:, 1]) <= reach]
        return [(float(r), float(c)) for r, c in near]


def _field_cells(is_occupied: NDArray[np.bool_]) -> FloatArray:
    """(H, W) distance from each cell's centre to the nearest wall cell's boundary, in cells."""
    # The point of a square nearest to a cell's centre is one of its corners or edge mid-points:
    # nodes of a grid twice as fine, on which the transform between nodes is therefore exact.
    height, width = is_occupied.shape
    is_free = np.ones((2 * height + 1, 2 * width + 1), dtype=bool)
    for up in range(3):
        for right in range(3):
            is_free[up : up + 2 * height : 2, right : right + 2 * width : 2] &= ~is_occupied
    fine: FloatArray = ndimage.distance_transform_edt(is_free)
    return np.ascontiguousarray(fine[1::2, 1::2]) * 0.5
