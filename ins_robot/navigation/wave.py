# SPDX-License-Identifier: MIT
"""Dijkstra waves over priced ground: cost per metre of cells in, cheapest ways out.

8-connected, no corner cut: both cells beside a diagonal step must be open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from ins_robot.geometry.angles import FloatArray

IndexArray = NDArray[np.int64]
Cell = tuple[int, int]

STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, math.sqrt(2.0)), (1, -1, math.sqrt(2.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Open cells as a graph.

    Attributes
    ----------
    edges : (V, V) sparse
        Cost in metres between open cells that touch.
    flat : (V,) int64
        Flat index of each open cell.
    number : (H, W) int32
        Which open cell each is; negative where it is closed.
    """

    edges: csr_matrix
    flat: IndexArray
    number: NDArray[np.int32]

    def costs_between(self, cells: IndexArray, limit_m: float = math.inf) -> FloatArray:
        """(N, N) cost between open cells (N, 2); inf where there is no way."""
        index = self.number[cells[:, 0], cells[:, 1]]
        costs: FloatArray = dijkstra(self.edges, directed=False, indices=index, limit=limit_m)
        return np.asarray(costs[:, index])


def ground_of(factor: FloatArray, resolution_m: float) -> Ground:
    """The graph of cells whose factor (H, W), cost per metre, is finite."""
    height, width = factor.shape
    is_open = np.isfinite(factor)
    flat = np.flatnonzero(is_open)
    number = np.full(height * width, -1, np.int32)
    number[flat] = np.arange(len(flat), dtype=np.int32)
    number = number.reshape(height, width)
    rows, cols, weights = [], [], []
    for down, right, length in STEPS:
        here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
        there = (slice(down, height), slice(max(0, right), width + min(0, right)))
        ok = is_open[here] & is_open[there]
        if right and down:
            ok &= is_open[here[0], there[1]] & is_open[there[0], here[1]]
        rows.append(number[here][ok])
        cols.append(number[there][ok])
        weights.append((0.5 * length * resolution_m) * (factor[here][ok] + factor[there][ok]))
    edges = csr_matrix(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(cols))),
        shape=(len(flat), len(flat)),
    )
    return Ground(edges=edges, flat=flat, number=number)


def wave(factor: FloatArray, start: Cell, resolution_m: float) -> tuple[FloatArray, IndexArray]:
    """Cheapest cost (H, W) from a cell to every other, and the flat index of the cell before.

    Cost is inf, and the cell before negative, where there is no way.
    """
    height, width = factor.shape
    cost = np.full((height, width), np.inf)
    before = np.full((height, width), -1, np.int64)
    if not (0 <= start[0] < height and 0 <= start[1] < width) or not math.isfinite(
        factor[start]
    ):
        return cost, before
    ground = ground_of(factor, resolution_m)
    distance, previous = dijkstra(
        ground.edges,
        directed=False,
        indices=int(ground.number[start]),
        return_predecessors=True,
    )
    cost.reshape(-1)[ground.flat] = distance
    has_one = previous >= 0
    before.reshape(-1)[ground.flat[has_one]] = ground.flat[previous[has_one]]
    return cost, before
