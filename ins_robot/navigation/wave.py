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
    ends, is_link = _links(number, flat)
    first = np.zeros(len(flat) + 1, np.int32)
    np.cumsum(is_link.view(np.int8) @ np.ones(len(STEPS), np.int8), out=first[1:])
    weights = factors[ends]
    weights += factors[:, None]
    weights *= 0.5 * resolution_m * np.array([length for _, _, length in STEPS])
    linked = np.flatnonzero(is_link)
    shape = len(flat), len(flat)
    edges = csr_matrix((weights.take(linked), ends.take(linked), first), shape=shape)
    return Ground(edges=edges, flat=flat, number=number)


def _links(
    number: NDArray[np.int32], flat: IndexArray
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """(V, 4) for each open cell those that far on, by number, and where one can step over."""
    width = number.shape[1] + 2
    beside = np.pad(number, 1, constant_values=-1).reshape(-1)
    at = (flat // number.shape[1] + 1) * width + flat % number.shape[1] + 1
    ends = np.stack([beside[at + down * width + right] for down, right, _ in STEPS], axis=1)
    is_link = ends >= 0
    is_link[:, 1] &= is_link[:, 2] & (beside[at - 1] >= 0)
    is_link[:, 3] &= is_link[:, 2] & is_link[:, 0]
    return ends, is_link


def wave(
    factor: FloatArray, start: Cell, resolution_m: float, limit_m: float = math.inf
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Cheapest cost (H, W) from a cell to every other, and the flat index of the cell before.

    Cost is inf, and the cell before negative, where there is no way as cheap as `limit_m`.
    """
    height, width = factor.shape
    cost = np.full((height, width), np.inf)
    before = np.full((height, width), -1, np.int32)
    if not (0 <= start[0] < height and 0 <= start[1] < width and math.isfinite(factor[start])):
        return cost, before
    # a metre costs at least one: what is farther off than the limit need not be looked at
    reach = height + width if math.isinf(limit_m) else math.ceil(limit_m / resolution_m)
    top, left = max(start[0] - reach, 0), max(start[1] - reach, 0)
    near = slice(top, start[0] + reach + 1), slice(left, start[1] + reach + 1)
    ground = ground_of(factor[near], resolution_m)
    flat = ground.flat
    distance, previous = dijkstra(
        ground.edges,
        directed=False,
        indices=int(ground.number[start[0] - top, start[1] - left]),
        return_predecessors=True,
        limit=limit_m,
    )
    inner = ground.number.shape[1]
    del ground  # large, on a large map
    if (inner, top) != (width, 0):
        flat = (flat // inner + top) * width + flat % inner + left
    cost.reshape(-1)[flat] = distance
    has_one = previous >= 0
    before.reshape(-1)[flat[has_one]] = flat[previous[has_one]]
    return cost, before
