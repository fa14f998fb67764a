# SPDX-License-Identifier: MIT
"""Local map for matching: surfels in, a smooth field and the nearest surfel of every cell out.

The field is exp(-d^2 / 2 s^2) of the distance to the nearest surfel, stamped around each of
them (no distance transform of the window), with a pyramid of maxima for multi-resolution
search. The table of nearest surfels replaces a search tree: a look-up is one index, for all
particles and beams at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.field_pyramid import Cell, FieldPyramid, Grades
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.mapping.surfels import Surfels

CELL_M = 0.05
REACH_CELLS = 7  # how far from a surfel a point still finds it
SMOOTH_STD_M = 0.08
GRADE_M = 0.01  # surfels whose deviations differ by less are equally sure


def _stamp_offsets() -> tuple[IntArray, FloatArray]:
    """Offsets (S, 2) of a disc in cells, farthest first, and their distances in cells."""
    side = np.arange(-REACH_CELLS, REACH_CELLS + 1)
    rows, cols = (a.reshape(-1) for a in np.meshgrid(side, side, indexing="ij"))
    distance = np.hypot(rows, cols)
    order = np.argsort(-distance, kind="stable")
    order = order[distance[order] <= REACH_CELLS]
    return np.stack([rows[order], cols[order]], axis=-1), distance[order]


STAMP_OFFSETS, STAMP_DISTANCES = _stamp_offsets()
STAMP_GRADES = np.arange(1, len(STAMP_OFFSETS) + 1, dtype=np.uint8)  # 0 is out of reach
STAMP_BLOCK = 32  # offsets stamped together: what a processor's cache holds (measured)
GRADE_VALUES = np.zeros(len(STAMP_OFFSETS) + 1)
# in single precision: sums of them in double are exact, and the same in any order
GRADE_VALUES[1:] = np.float32(np.exp(-0.5 * (STAMP_DISTANCES * CELL_M / SMOOTH_STD_M) ** 2))


class LikelihoodField:
    """Surfels on a window of cells.

    Attributes
    ----------
    surfels : Surfels
        One per cell at most, in the map frame; the surest of each cell.
    columns : (7, N) float64
        The same, for look-ups in one go: x, y, normal x and y, variance, tilt variance, flat.
    grades : (H, W) uint8
        Which stamp a cell shows, that of its nearest surfel; place in GRADE_VALUES.
    nearest : (H*W,) int32
        Nearest surfel of each cell, -1 where none is within reach. A rim of cells around the
        window is always -1, so that points outside are clipped onto it.
    """

    def __init__(self, surfels: Surfels) -> None:
        scaled = np.floor(surfels.points_m.T * (1.0 / CELL_M))
        cols, rows = scaled.astype(np.int64)
        margin = REACH_CELLS + 1
        self._corner: Cell = int(cols.min()) - margin, int(rows.min()) - margin
        self.width = int(cols.max()) + margin + 1 - self._corner[0]
        self.height = int(rows.max()) + margin + 1 - self._corner[1]
        flat = (rows - self._corner[1]) * self.width + cols - self._corner[0]
        # one surfel per cell, the surest, of equals the oldest node's (least drift): written
        # last, it stays
        grade = np.floor(surfels.std_m / GRADE_M).astype(np.int64)
        order = np.lexsort((-surfels.sources, -grade))
        table = np.full(self.width * self.height, -1, dtype=np.int32)
        table[flat[order]] = order
        occupied = np.flatnonzero(table >= 0)
        self.surfels = surfels.take(table[occupied].astype(np.int64))
        table[occupied] = np.arange(len(occupied))
        steps = STAMP_OFFSETS[:, 0] * self.width + STAMP_OFFSETS[:, 1]
        grades = self._stamped(occupied, steps)
        self.grades = grades.reshape(self.height, self.width)
        # back from each cell to the one whose stamp it shows
        stamped_by = np.arange(len(grades)) - np.append(0, steps).take(grades)
        self.nearest: NDArray[np.int32] = table.take(stamped_by)
        kept = self.surfels
        self.columns: FloatArray = np.stack(
            [
                *kept.points_m.T,
                *kept.normals.T,
                kept.std_m**2,
                kept.tilt_std_rad**2,
                kept.is_flat.astype(np.float64),
            ]
        )

    def cells(self, points_m: FloatArray) -> tuple[IntArray, IntArray]:
        """(...) columns and rows of points (..., 2); may lie outside."""
        scaled = np.floor(points_m * (1.0 / CELL_M)).astype(np.int64)
        return scaled[..., 0] - self._corner[0], scaled[..., 1] - self._corner[1]

    def nearest_surfels(self, x_m: FloatArray, y_m: FloatArray) -> NDArray[np.int32]:
        """(...) index of the surfel nearest to each point, -1 without one in reach."""
        col = _clipped(x_m * (1.0 / CELL_M) - self._corner[0], self.width)
        row = _clipped(y_m * (1.0 / CELL_M) - self._corner[1], self.height)
        row *= self.width
        row += col
        return self.nearest.take(row)

    def pyramid(self, low: Cell, high: Cell, level: int) -> FieldPyramid:
        """Of the cells from `low` to before `high`, up to a level; 0 outside the window."""
        shown = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
        inside = self.grades[max(low[1], 0) : max(high[1], 0), max(low[0], 0) : max(high[0], 0)]
        top, left = max(-low[1], 0), max(-low[0], 0)
        shown[top : top + inside.shape[0], left : left + inside.shape[1]] = inside
        return FieldPyramid(shown, GRADE_VALUES, low, level)

    def _stamped(self, occupied: IntArray, steps: IntArray) -> Grades:
        """(H*W,) grades in the flattened window; the nearest stamps stay.

        `steps` (S,) lead from a cell that is occupied to those that it stamps.
        """
        grades = np.zeros(self.width * self.height, np.uint8)
        for first in range(0, len(steps), STAMP_BLOCK):
            block = slice(first, first + STAMP_BLOCK)
            cells = (steps[block, None] + occupied).reshape(-1)
            grades[cells] = np.repeat(STAMP_GRADES[block], len(occupied))
        return grades


def _clipped(cells: FloatArray, count: int) -> IntArray:
    """(...) whole cells from 0 to before `count`; overwrites what it is given."""
    np.maximum(cells, 0.0, out=cells)  # np.clip takes three times as long for few
    np.minimum(cells, count - 1.0, out=cells)
    return cells.astype(np.int64)
