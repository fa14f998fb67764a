# SPDX-License-Identifier: MIT
"""Distance to the walls of a finished map, smooth, for matching; negative deep inside them.

Readings made the cells of a wall, so it is 0 at their centres, all through walls that are thin:
at a face it would have one optimum on either side. Unknown cells are no walls. Far from any
wall the distance is cut off, so that what lies there neither pulls nor counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.map_files import BoolArray, GridView

REACH_M = 1.0  # distances are cut off here
THIN_CELLS = 2  # a cell this near the wall's surface is as good as on it


class DistanceMap:
    """A finished map as distances, with a rim of empty cells around it.

    Attributes
    ----------
    resolution_m : float
    origin_m : (2,)
        Outer corner (x, y) of cell (0, 0), rim included.
    is_occupied, is_free : (H, W) bool
    signed_m : (H, W) float32
        From each cell's centre to the nearest of a wall's cells, within +-`REACH_M`.
    """

    def __init__(self, grid: GridView, rim_m: float = REACH_M) -> None:
        rim_cells = int(np.ceil(rim_m / grid.resolution_m)) + 1
        self.resolution_m = grid.resolution_m
        self.origin_m = np.array(grid.origin_m) - rim_cells * grid.resolution_m
        self.is_occupied: BoolArray = np.pad(grid.is_occupied, rim_cells)
        self.is_free: BoolArray = np.pad(grid.is_free, rim_cells)
        self.signed_m: NDArray[np.float32] = self._signed()
        self._flat = self.signed_m.reshape(-1)

    def _signed(self) -> NDArray[np.float32]:
        if not self.is_occupied.any():
            return np.full(self.is_occupied.shape, REACH_M, np.float32)
        outside = distance_transform_edt(~self.is_occupied)
        inside = distance_transform_edt(self.is_occupied) - THIN_CELLS
        signed_m = (outside - np.maximum(inside, 0.0)) * self.resolution_m
        return np.asarray(np.clip(signed_m, -REACH_M, REACH_M), dtype=np.float32)

    def cells(self, points_m: FloatArray) -> FloatArray:
        """(..., 2) points (x, y) -> continuous (row, col); floor gives the cell."""
        cells: FloatArray = (points_m - self.origin_m)[..., ::-1] / self.resolution_m
        return cells

    def metres(self, cells: FloatArray) -> FloatArray:
        """(..., 2) continuous (row, col) -> points (x, y); a cell's centre is at + 0.5."""
        points: FloatArray = cells[..., ::-1] * self.resolution_m + self.origin_m
        return points

    def with_slope(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(...) distances at points (..., 2) and their derivatives by x and by y; bilinear."""
        height, width = self.signed_m.shape
        inverse = 1.0 / self.resolution_m
        x = points_m[..., 0] * inverse - (self.origin_m[0] * inverse + 0.5)
        y = points_m[..., 1] * inverse - (self.origin_m[1] * inverse + 0.5)
        np.clip(x, 0.0, width - 1.001, out=x)
        np.clip(y, 0.0, height - 1.001, out=y)
        col, row = x.astype(np.int64), y.astype(np.int64)
        x -= col
        y -= row
        at = row * width + col
        low_left, low_right = self._flat.take(at), self._flat.take(at + 1)
        at += width
        high_left, high_right = self._flat.take(at), self._flat.take(at + 1)
        low = low_left + x * (low_right - low_left)
        high = high_left + x * (high_right - high_left)
        by_x = (low_right - low_left) * (1.0 - y) + (high_right - high_left) * y
        return low + y * (high - low), by_x * inverse, (high - low) * inverse
