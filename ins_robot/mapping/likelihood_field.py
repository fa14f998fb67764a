# SPDX-License-Identifier: MIT
"""Local map for matching: surfels in, a smooth field and the nearest surfel of every cell out.

The field is exp(-d^2 / 2 s^2) of the distance to the nearest surfel, stamped around each of them
(no distance transform of the window), with a pyramid of maxima for multi-resolution search
(Olson 2009; Hess et al. 2016). The table of nearest surfels replaces a search tree: a look-up is
one index, for all particles and beams at once.
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
    nearest : (H*W,) int32
        Nearest surfel of each cell, -1 where none is within reach.
    """

    def __init__(self, surfels: Surfels) -> None:
        cells = np.floor(surfels.points_m / CELL_M).astype(np.int64)
        margin = REACH_CELLS + 2 ** (LEVELS - 1)
        self._corner = cells.min(axis=0) - margin
        self.width, self.height = (cells.max(axis=0) + margin + 1 - self._corner).tolist()
        flat = (cells[:, 1] - self._corner[1]) * self.width + cells[:, 0] - self._corner[0]
        # one surfel per cell, the surest: it is written last, and stays
        order = np.argsort(-surfels.std_m, kind="stable")
        table = np.full(self.width * self.height, -1, dtype=np.int32)
        table[flat[order]] = order
        kept = table[table >= 0]
        self.surfels = surfels.take(kept)
        flat = flat[kept]
        around = STAMP_OFFSETS[:, 0] * self.width + STAMP_OFFSETS[:, 1]
        targets = (around[:, None] + flat).reshape(-1)
        table.fill(-1)
        table[targets] = np.tile(np.arange(len(flat), dtype=np.int32), len(around))
        self.nearest: NDArray[np.int32] = table
        values = np.zeros(self.width * self.height, np.float32)
        values[targets] = np.repeat(STAMP_VALUES, len(flat))
        self._levels = [values.reshape(self.height, self.width)]

    def cells(self, points_m: FloatArray) -> tuple[IntArray, IntArray]:
        """(...) columns and rows of points (..., 2); may lie outside."""
        scaled = np.floor(points_m * (1.0 / CELL_M)).astype(np.int64)
        return scaled[..., 0] - self._corner[0], scaled[..., 1] - self._corner[1]

    def nearest_surfels(self, points_m: FloatArray) -> IntArray:
        """(...) index of the surfel nearest to each point (..., 2), -1 without one in reach."""
        cols, rows = self.cells(points_m)
        inside = (cols >= 0) & (cols < self.width) & (rows >= 0) & (rows < self.height)
        found = self.nearest[np.where(inside, rows * self.width + cols, 0)]
        return np.where(inside, found, -1)

    def level(self, level: int) -> NDArray[np.float32]:
        """(H, W) maxima of the field over the 2^level cells to the right and above."""
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
        values = self.level(level)
        inside = (cols >= 0) & (cols < self.width) & (rows >= 0) & (rows < self.height)
        flat = np.where(inside, rows * self.width + cols, 0)  # the window's corner holds 0
        return np.asarray(values.reshape(-1)[flat].mean(axis=-1, dtype=np.float64))
