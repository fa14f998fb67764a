# SPDX-License-Identifier: MIT
"""Lines of sight on the grid, many at once: blocked cells and pairs of points in, bool out.

Lines are sampled finer than a cell; both ends are left out, so that one may look from and at a
cell that is itself blocked.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray

SAMPLE_CELLS = 0.5
BoolArray = NDArray[np.bool_]


def sees(is_blocked: BoolArray, starts: FloatArray, ends: FloatArray) -> BoolArray:
    """(A, B) bool: whether each of A starts sees each of B ends.

    Parameters
    ----------
    is_blocked : (H, W) bool
    starts, ends : (A, 2) and (B, 2) float64
        Continuous cells (row, col); outside the grid nothing blocks.
    """
    starts, ends = np.asarray(starts, float), np.asarray(ends, float)
    if len(starts) == 0 or len(ends) == 0:
        return np.zeros((len(starts), len(ends)), bool)
    delta = ends[None, :, :] - starts[:, None, :]
    longest = float(np.hypot(delta[..., 0], delta[..., 1]).max())
    count = max(1, math.ceil(longest / SAMPLE_CELLS))
    share = (np.arange(count) + 0.5) / count
    rows = np.floor(starts[:, None, None, 0] + delta[..., None, 0] * share).astype(np.int64)
    cols = np.floor(starts[:, None, None, 1] + delta[..., None, 1] * share).astype(np.int64)
    height, width = is_blocked.shape
    inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
    blocked = inside & is_blocked.ravel().take(np.where(inside, rows * width + cols, 0))
    own = _is_end_cell(rows, cols, starts[:, None, None, :]) | _is_end_cell(
        rows, cols, ends[None, :, None, :]
    )
    return np.asarray(~(blocked & ~own).any(axis=-1))


def _is_end_cell(rows: np.ndarray, cols: np.ndarray, cells: FloatArray) -> BoolArray:
    floor = np.floor(cells).astype(np.int64)
    return np.asarray((rows == floor[..., 0]) & (cols == floor[..., 1]))
