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

DIAGONAL = math.sqrt(2.0)
STEPS = ((0, 1, 1.0), (1, -1, DIAGONAL), (1, 0, 1.0), (1, 1, DIAGONAL))  # as cells are numbered


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
    flat = np.flatnonzero(np.isfinite(factor))
    number = np.full(factor.shape, -1, np.int32)
    number.reshape(-1)[flat] = np.arange(len(flat), dtype=np.int32)
    factors = factor.reshape(-1)[flat]
    links = [_links(number, down, right) for down, right, _ in STEPS]
    # rows of the matrix are filled in place: on a large map sorting triplets takes 20 MB more
    first = np.zeros(len(flat) + 1, np.int32)
    for start, _ in links:
        first[start + 1] += 1
    np.cumsum(first, out=first)
    ends, weights = np.empty(first[-1], np.int32), np.empty(first[-1])
    free = first[:-1].copy()
    for (start, end), (_, _, length) in zip(links, STEPS, strict=True):
        at = free[start]
        ends[at] = end
        weights[at] = (0.5 * length * resolution_m) * (factors[start] + factors[end])
        free[start] += 1
    edges = csr_matrix((weights, ends, first), shape=(len(flat), len(flat)))
    return Ground(edges=edges, flat=flat, number=number)


def _links(
    number: NDArray[np.int32], down: int, right: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Open cells and those that far on, by number, where one can step over."""
    height, width = number.shape
    here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
    there = (slice(down, height), slice(max(0, right), width + min(0, right)))
    is_open = number >= 0
    ok = is_open[here] & is_open[there]
    if right and down:
        ok &= is_open[here[0], there[1]] & is_open[there[0], here[1]]
    return number[here][ok], number[there][ok]


def wave(
    factor: FloatArray, start: Cell, resolution_m: float
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Cheapest cost (H, W) from a cell to every other, and the flat index of the cell before.

    Cost is inf, and the cell before negative, where there is no way.
    """
    height, width = factor.shape
    distance, previous, flat = np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int64)
    if 0 <= start[0] < height and 0 <= start[1] < width and math.isfinite(factor[start]):
        ground = ground_of(factor, resolution_m)
        flat = ground.flat
        distance, previous = dijkstra(
            ground.edges,
            directed=False,
            indices=int(ground.number[start]),
            return_predecessors=True,
        )
        del ground  # large, on a large map
    cost = np.full((height, width), np.inf)
    before = np.full((height, width), -1, np.int32)
    cost.reshape(-1)[flat] = distance
    has_one = previous >= 0
    before.reshape(-1)[flat[has_one]] = flat[previous[has_one]]
    return cost, before
