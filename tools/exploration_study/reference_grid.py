# SPDX-License-Identifier: MIT
"""The world of the published baselines: 0.1 m cells, a perfect pose, three states a cell.

The LRF has 720 rays all around, 6 m, sampled every half cell; the robot is a disc of 0.2 m on
cell centres. What counts as observable is what is seen from a lattice of 0.5 m over all it can
reach, and from the start.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ins_robot.simulation.world_files import read_world

CELL_M, RANGE_M, RADIUS_M = 0.1, 6.0, 0.2
RAYS, LATTICE_CELLS = 720, 5
UNKNOWN, FREE, OCCUPIED = 0, 1, 2
PAD = 64  # cells outside the world, so that no ray leaves the array
Cell = tuple[int, int]


class ReferenceGrid:
    """A world and what of it can be seen; arrays are padded by `PAD` cells of neither."""

    def __init__(self, is_free: NDArray[np.bool_], start: Cell) -> None:
        self.truth = np.pad(np.where(is_free, FREE, OCCUPIED).astype(np.uint8), PAD)
        self.start = (start[0] + PAD, start[1] + PAD)
        self._rays = _ray_cells(RAYS, RANGE_M / CELL_M, 0.5, self.truth.shape[1])
        self.body = disc(RADIUS_M / CELL_M)
        self.is_open = (self.truth == FREE) & ~ndimage.binary_dilation(
            self.truth == OCCUPIED, self.body
        )
        labels, _ = ndimage.label(self.is_open)
        own = labels[self.start]
        self.is_reachable = (labels == own) & (own > 0)
        self.is_target = self._observable()

    def scan(self, cell: Cell, known: NDArray[np.uint8]) -> None:
        """What the LRF sees from a cell, written into `known`."""
        flat = self._rays + (cell[0] * self.truth.shape[1] + cell[1])
        hit = self.truth.take(flat) != FREE
        stop = np.where(hit.any(axis=1), hit.argmax(axis=1), hit.shape[1])
        is_before = np.arange(hit.shape[1]) < stop[:, None]
        known[cell] = FREE
        known.reshape(-1)[flat[is_before]] = FREE
        ends = flat[np.arange(len(flat)), np.minimum(stop, hit.shape[1] - 1)]
        ends = ends[(stop < hit.shape[1]) & (self.truth.take(ends) == OCCUPIED)]
        known.reshape(-1)[ends] = OCCUPIED

    def coverage(self, known: NDArray[np.uint8]) -> float:
        """Share of the observable free cells that are known."""
        return float(((known == FREE) & self.is_target).sum() / self.is_target.sum())

    def _observable(self) -> NDArray[np.bool_]:
        known = np.zeros_like(self.truth)
        inner = self.is_reachable[PAD:-PAD, PAD:-PAD]
        for row, col in np.argwhere(inner[::LATTICE_CELLS, ::LATTICE_CELLS]) * LATTICE_CELLS:
            self.scan((int(row) + PAD, int(col) + PAD), known)
        self.scan(self.start, known)
        return known == FREE


def disc(radius_cells: float) -> NDArray[np.bool_]:
    """Cells whose centre is within a radius of the middle one's."""
    reach = math.ceil(radius_cells)
    up, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return up**2 + right**2 <= radius_cells**2


def _ray_cells(
    count: int, reach_cells: float, step_cells: float, width: int
) -> NDArray[np.int64]:
    """(count, samples) flat offsets of the cells along rays from a cell's centre."""
    bearings = 2.0 * np.pi * np.arange(count) / count
    along = step_cells * (1.0 + np.arange(math.ceil(reach_cells / step_cells)))
    rows = np.floor(0.5 + np.sin(bearings)[:, None] * along).astype(np.int64)
    cols = np.floor(0.5 + np.cos(bearings)[:, None] * along).astype(np.int64)
    return rows * width + cols


@lru_cache(maxsize=2)
def load_reference_grid(path: Path, x_m: float, y_m: float) -> ReferenceGrid:
    """A map_server world of 0.05 m, four cells to one: free where at least three are."""
    is_free = read_world(path).is_free[::-1]
    is_free = np.pad(is_free, [(0, n % 2) for n in is_free.shape])
    height, width = (n // 2 for n in is_free.shape)
    is_free = is_free.reshape(height, 2, width, 2).sum(axis=(1, 3)) >= 3
    return ReferenceGrid(is_free, (int(height - y_m / CELL_M), int(x_m / CELL_M)))
