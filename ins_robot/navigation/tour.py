# SPDX-License-Identifier: MIT
"""Short open tours: costs between places in, an order to visit them all out.

The tour begins at place 0 and ends anywhere, for the price of ending there. Nearest neighbour,
from several first places, made better by 2-opt and Or-opt moves (Croes 1958, Or 1976) until
none helps: for the few dozen places of one decision within a few per cent of the best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray

Order = NDArray[np.int64]
STARTS = 4  # first places tried, nearest first
SEGMENT = 3  # longest run of places moved as one
BETTER = 1e-9


def open_tour(costs: FloatArray, end_m: FloatArray | None = None) -> tuple[Order, float]:
    """Order of all places, 0 first, and its cost.

    Parameters
    ----------
    costs : (N, N) float64
        Symmetric and finite.
    end_m : (N,) float64, optional
        What it costs to end at a place; nothing anywhere.
    """
    count = len(costs)
    end_m = np.zeros(count) if end_m is None else end_m
    if count == 1:
        return np.zeros(1, np.int64), 0.0
    best: tuple[Order, float] | None = None
    for first in np.argsort(costs[0, 1:], kind="stable")[:STARTS] + 1:
        order = _improve(costs, end_m, _nearest_neighbours(costs, int(first)))
        cost = float(costs[order[:-1], order[1:]].sum() + end_m[order[-1]])
        if best is None or cost < best[1] - BETTER:
            best = order, cost
    assert best is not None
    return best


def _nearest_neighbours(costs: FloatArray, first: int) -> Order:
    order = [0, first]
    left = costs.copy()
    left[:, [0, first]] = np.inf
    while len(order) < len(costs):
        nearest = int(left[order[-1]].argmin())
        order.append(nearest)
        left[:, nearest] = np.inf
    return np.array(order, np.int64)


def _improve(costs: FloatArray, end_m: FloatArray, order: Order) -> Order:
    """Best move first, until none is left."""
    while True:
        between = np.column_stack([costs[np.ix_(order, order)], end_m[order]])
        gain, moved = _two_opt(between, order)
        for length in range(1, min(SEGMENT, len(order) - 1) + 1):
            other, other_moved = _or_opt(between, order, length)
            if other < gain:
                gain, moved = other, other_moved
        if gain > -BETTER:
            return order
        order = moved


def _two_opt(between: FloatArray, order: Order) -> tuple[float, Order]:
    """Best reversal of places i..j: what it adds to the cost, and the order after it."""
    count = len(order)
    link = between[np.arange(count), np.arange(1, count + 1)]  # of each place to the next
    i, j = np.triu_indices(count, 1)
    i, j = i[i > 0], j[i > 0]
    if len(i) == 0:
        return 0.0, order
    change = between[i - 1, j] - link[i - 1] + between[i, j + 1] - link[j]
    best = int(change.argmin())
    first, last = int(i[best]), int(j[best])
    moved = order.copy()
    moved[first : last + 1] = moved[first : last + 1][::-1]
    return float(change[best]), moved


def _or_opt(between: FloatArray, order: Order, length: int) -> tuple[float, Order]:
    """Best move of `length` places in a row to elsewhere, turned round or not."""
    count = len(order)
    link = between[np.arange(count), np.arange(1, count + 1)]
    i = np.arange(1, count - length + 1)
    j = i + length - 1
    k = np.arange(count)
    saved = link[i - 1] + link[j] - between[i - 1, j + 1]
    after = between[:, k + 1]  # (N, N): from a place to the one after k
    as_is = between[k[None, :], i[:, None]] + after[j] - link[None, :]
    turned = between[k[None, :], j[:, None]] + after[i] - link[None, :]
    inside = (k[None, :] >= i[:, None] - 1) & (k[None, :] <= j[:, None])
    change = np.minimum(as_is, turned) - saved[:, None]
    change[inside] = np.inf
    at, to = np.unravel_index(int(change.argmin()), change.shape)
    first, last = int(i[at]), int(j[at])
    piece = order[first : last + 1]
    if turned[at, to] < as_is[at, to]:
        piece = piece[::-1]
    rest = np.concatenate([order[:first], order[last + 1 :]])
    put = int(to) + 1 if to < first else int(to) + 1 - length
    return float(change[at, to]), np.concatenate([rest[:put], piece, rest[put:]])
