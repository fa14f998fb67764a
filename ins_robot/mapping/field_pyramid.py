# SPDX-License-Identifier: MIT
"""Maxima of a field over ever larger squares of cells, to search it from coarse to fine.

A window of a field in, as grades: places in a table of values that ascends. The greatest grade
is that of the greatest value, so maxima of bytes do for maxima of numbers. Olson (2009); Hess
et al. (2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import IntArray

Grades = NDArray[np.uint8]
Cell = tuple[int, int]  # (column, row)


class FieldPyramid:
    """Level k holds the maxima over the 2^k x 2^k cells to the right of and above each cell.

    Parameters
    ----------
    grades : (H, W) uint8
        Of the window's cells.
    values : (G,) float64
        Of the grades, ascending.
    corner : (column, row)
        The window's first cell in the field.
    level : int
        The coarsest. It is not whole for the last 2^level - 1 rows and columns.
    """

    def __init__(self, grades: Grades, values: FloatArray, corner: Cell, level: int) -> None:
        self._values = values
        self._corner = corner
        self._width = grades.shape[1]
        self._levels = [grades.reshape(-1)]
        for k in range(level):
            self._levels.append(_coarser(self._levels[-1], self._width, 2**k))

    def cells(self, cols: IntArray, rows: IntArray) -> IntArray:
        """(...) the field's cells, as `mean_values` wants them."""
        return self.steps(cols - self._corner[0], rows - self._corner[1])

    def steps(self, cols: IntArray, rows: IntArray) -> IntArray:
        """(...) what takes a cell of `mean_values` so many columns and rows further."""
        return np.asarray(rows * self._width + cols)

    def mean_values(self, cells: IntArray, level: int) -> FloatArray:
        """(C,) mean of a level over the last axis of cells (C, B)."""
        return np.asarray(self._values.take(self._levels[level].take(cells)).mean(axis=-1))


def _coarser(finer: Grades, width: int, step: int) -> Grades:
    """The next level, of a flat one whose maxima are over `step` cells."""
    right = finer.copy()
    np.maximum(finer[:-step], finer[step:], out=right[:-step])
    coarse, above = right.copy(), step * width
    np.maximum(right[:-above], right[above:], out=coarse[:-above])
    return coarse
