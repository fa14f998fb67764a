# SPDX-License-Identifier: MIT
"""Local map for matching: surfels in, a smooth field and the nearest surfel of every cell out.

The field is exp(-d^2 / 2 s^2) of the distance to the nearest surfel, stamped around each of
them (no distance transform of the window), with a pyramid of maxima for multi-resolution search
(Olson 2009; Hess et al. 2016). The table of nearest surfels replaces a search tree: a look-up
is one index, for all particles and beams at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.mapping.surfels import Surfels

CELL_M = 0.05
REACH_CELLS = 7  # how far from a surfel a point still finds it
SMOOTH_STD_M = 0.08
GRADE_M = 0.01  # surfels whose deviations differ by less are equally sure
LEVELS = 4  # cells of the coarsest level are 2^(LEVELS-1) fine ones wide


def _stamp_offsets() -> tuple[IntArray, FloatArray]:
    """Offsets (S, 2) of a disc in cells, farthest first, and their distances in cells."""
    side = np.arange(-REACH_CELLS, REACH_CELLS + 1)
    rows, cols = (a.reshape(-1) for a in np.meshgrid(side, side, indexing="ij"))
    distance = np.hypot(rows, cols)
    order = np.argsort(-distance, kind="stable")
    order = order[distance[order] <= REACH_CELLS]
    return np.stack([rows[order], cols[order]], axis=-1), distance[order]


STAMP_OFFSETS, STAMP_DISTANCES = _stamp_offsets()
STAMP_VALUES = np.exp(-0.5 * (STAMP_DISTANCES * CELL_M / SMOOTH_STD_M) ** 2).astype(np.float32)


class LikelihoodField:
    """Surfels on a window of cells.

    Attributes
    ----------
    surfels : Surfels
        One per cell at most, in the map frame; the surest of each cell.
    columns : (7, N) float64
        The same, for look-ups in one go: x, y, normal x and y, variance, tilt variance, flat.
    nearest : (H*W,) int32
        Nearest surfel of each cell, -1 where none is within reach. A rim of cells around the
        window is always -1, so that points outside are clipped onto it.
    """

    def __init__(self, surfels: Surfels) -> None:
        cells = np.floor(surfels.points_m * (1.0 / CELL_M)).astype(np.int64)
        margin = REACH_CELLS + 2 ** (LEVELS - 1)
        self._corner: list[int] = (cells.min(axis=0) - margin).tolist()
        high: list[int] = (cells.max(axis=0) + margin + 1).tolist()
        self.width, self.height = high[0] - self._corner[0], high[1] - self._corner[1]
        flat = (cells[:, 1] - self._corner[1]) * self.width + cells[:, 0] - self._corner[0]
        # one surfel per cell, the surest, of equals the oldest node's (least drift): written
        # last, it stays
        grade = np.floor(surfels.std_m / GRADE_M).astype(np.int64)
        order = np.lexsort((-surfels.sources, -grade))
        table = np.full(self.width * self.height, -1, dtype=np.int32)
        table[flat[order]] = order
        occupied = np.flatnonzero(table >= 0)
        self.surfels = surfels.take(table[occupied].astype(np.int64))
        self._targets = (_around(self.width)[:, None] + occupied.astype(np.int32)).reshape(-1)
        table[self._targets] = np.tile(
            np.arange(len(occupied), dtype=np.int32), len(STAMP_OFFSETS)
        )
        self.nearest: NDArray[np.int32] = table
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
        self._levels: list[NDArray[np.float32]] = []

    def cells(self, points_m: FloatArray) -> tuple[IntArray, IntArray]:
        """(...) columns and rows of points (..., 2); may lie outside."""
        scaled = np.floor(points_m * (1.0 / CELL_M)).astype(np.int64)
        return scaled[..., 0] - self._corner[0], scaled[..., 1] - self._corner[1]

    def nearest_surfels(self, x_m: FloatArray, y_m: FloatArray) -> NDArray[np.int32]:
        """(...) index of the surfel nearest to each point, -1 without one in reach."""
        col = np.clip(x_m * (1.0 / CELL_M) - self._corner[0], 0, self.width - 1)
        row = np.clip(y_m * (1.0 / CELL_M) - self._corner[1], 0, self.height - 1)
        index = row.astype(np.int32) * np.int32(self.width) + col.astype(np.int32)
        return self.nearest.take(index)

    def level(self, level: int) -> NDArray[np.float32]:
        """(H, W) maxima of the field over the 2^level cells to the right and above."""
        if not self._levels:
            values = np.zeros(self.width * self.height, np.float32)
            values[self._targets] = np.repeat(STAMP_VALUES, len(self.surfels))
            self._levels.append(values.reshape(self.height, self.width))
        while len(self._levels) <= level:
            finer = self._levels[-1]
            step = 2 ** (len(self._levels) - 1)
            coarse = finer.copy()
            np.maximum(coarse[:, :-step], finer[:, step:], out=coarse[:, :-step])
            wide = coarse.copy()
            np.maximum(coarse[:-step], wide[step:], out=coarse[:-step])
            self._levels.append(coarse)
        return self._levels[level]

    def mean_values(self, cols: IntArray, rows: IntArray, level: int) -> FloatArray:
        """(C,) mean of the field over the last axis of cells (C, B); 0 outside the window."""
        values = self.level(level).reshape(-1)
        np.clip(cols, 0, self.width - 1, out=cols)
        np.clip(rows, 0, self.height - 1, out=rows)
        rows *= self.width
        rows += cols
        return np.asarray(values.take(rows).mean(axis=-1, dtype=np.float64))


def _around(width: int) -> NDArray[np.int32]:
    """(S,) steps in the flattened window from a surfel's cell to those it stamps."""
    return (STAMP_OFFSETS[:, 0] * width + STAMP_OFFSETS[:, 1]).astype(np.int32)
