# SPDX-License-Identifier: MIT
"""How much unseen ground a scan from a place may show."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ins_robot.navigation.outlook import Cell, IndexArray, Outlook

RAYS = 180


def unseen_in_view(outlook: Outlook, place: Cell) -> int:
    """Unseen cells, inside the grid, that rays sampled once a cell come through."""
    flat, is_open = _open_samples(
        outlook, np.array([place]), RAYS, round(outlook.range_m / outlook.resolution_m)
    )
    seen = flat[is_open]
    return len(np.unique(seen[outlook.is_unseen.take(seen)]))


def _open_samples(
    outlook: Outlook, places: IndexArray, rays: int, reach: int
) -> tuple[IndexArray, NDArray[np.bool_]]:
    """(N, rays, reach) flat cells along rays, and whether the ray gets there."""
    rows, cols = _samples(rays, reach)
    rows, cols = rows + places[:, 0, None, None], cols + places[:, 1, None, None]
    height, width = outlook.is_opaque.shape
    inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
    flat = np.where(inside, rows * width + cols, 0)
    stops = ~inside | outlook.is_opaque.take(flat)
    return flat, ~np.logical_or.accumulate(stops, axis=2)


@lru_cache(maxsize=8)
def _samples(rays: int, reach: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(rays, reach) row and column offsets, a cell apart."""
    bearings = 2.0 * np.pi * np.arange(rays)[:, None] / rays
    along = 1.0 + np.arange(reach)
    return (
        np.floor(0.5 + np.sin(bearings) * along).astype(np.int64),
        np.floor(0.5 + np.cos(bearings) * along).astype(np.int64),
    )
