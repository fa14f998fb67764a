# SPDX-License-Identifier: MIT
"""What a strategy sees that chooses its own place to scan: a grid, the ground and the edges.

The explorer makes one of each scene, the benchmark's reference robot one of its plain grid, so
that a strategy runs in both unchanged. Cells are (row, col).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from ins_robot.geometry.angles import FloatArray

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.int64]
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class PastLooks:
    """Where scans were taken, and what they looked at.

    `cells` (K, 2) float64 are (row, col) of the places; a look covers `half_rad` (K,) to both
    sides of `towards_rad` (K,), about the columns' axis.
    """

    cells: FloatArray
    towards_rad: FloatArray
    half_rad: FloatArray

    def part(self, index: IndexArray) -> PastLooks:
        """Some of them, by index."""
        return PastLooks(
            cells=self.cells[index],
            towards_rad=self.towards_rad[index],
            half_rad=self.half_rad[index],
        )

    @staticmethod
    def none() -> PastLooks:
        """No look yet."""
        return PastLooks(cells=np.zeros((0, 2)), towards_rad=np.zeros(0), half_rad=np.zeros(0))


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """One decision's grid.

    Attributes
    ----------
    is_unseen, is_opaque : (H, W) bool
        What no scan has seen, and what stops sight.
    factor : (H, W) float64
        Cost per metre; inf where the robot must not be.
    cost_m : (H, W) float64
        Of the cheapest way from the robot; inf where there is none.
    before : (H, W) int32
        Flat index of the cell before on that way; negative at its start.
    here : (row, col)
        The robot's cell.
    edges : tuple of (n, 2) int64
        Connected runs of seen cells beside unseen ones.
    reach_cells : int
        A place within so many cells of an edge cell is a place at it.
    short_edges : tuple of (n, 2) int64
        Edges too short to be gone for before all others are done with.
    gain_min_m2 : float
        A scan that is expected to show no more adds nothing.
    looks : PastLooks
        What is unseen though it was looked at: another scan from there will not show it either.
    looks_on_the_way : bool
        The robot scans while it drives: what shows from the way needs no stop.
    limit_m : float
        Dearer ways are not known yet, and places to which they lead not all.
    wider : callable or None
        Gives an outlook with all ways as dear as told; None: there is no more.
    """

    resolution_m: float
    range_m: float
    is_unseen: BoolArray
    is_opaque: BoolArray
    factor: FloatArray
    cost_m: FloatArray
    before: NDArray[np.int32]
    here: Cell
    edges: tuple[IndexArray, ...]
    reach_cells: int
    short_edges: tuple[IndexArray, ...] = ()
    gain_min_m2: float = 0.0
    looks: PastLooks = field(default_factory=PastLooks.none)
    looks_on_the_way: bool = False
    limit_m: float = math.inf
    wider: Callable[[float], Outlook] | None = None

    @cached_property
    def cost_near_m(self) -> FloatArray:
        """(H, W) least cost within `reach_cells` of each cell."""
        near: FloatArray = minimum_filter(self.cost_m, size=2 * self.reach_cells + 1)
        return near

    @cached_property
    def reachable_edges(self) -> tuple[tuple[IndexArray, FloatArray], ...]:
        """Of each edge the cells (n, 2) a place is near to, and what it costs to get there."""
        found = []
        for cells in self.edges:
            cost = self.cost_near_m[cells[:, 0], cells[:, 1]]
            is_near = np.isfinite(cost)
            if is_near.any():
                found.append((cells[is_near], cost[is_near]))
        return tuple(found)

    def place_at(self, cell: IndexArray) -> Cell:
        """The cheapest place near a cell of an edge in reach."""
        first = np.maximum(cell - self.reach_cells, 0)
        last = cell + self.reach_cells + 1
        window = self.cost_m[first[0] : last[0], first[1] : last[1]]
        row, col = divmod(int(window.argmin()), window.shape[1])
        return int(first[0]) + row, int(first[1]) + col

    def way_to(self, cell: Cell) -> IndexArray:
        """(N, 2) cells of the cheapest way from the robot to a place."""
        width = self.before.shape[1]
        before = self.before.reshape(-1)
        way = [cell[0] * width + cell[1]]
        while (previous := int(before[way[-1]])) >= 0:
            way.append(previous)
        return np.stack(np.divmod(np.array(way[::-1]), width), axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Aim:
    """A place to scan from.

    `cell` is where to stand, `targets` (T, 2) the edge cells a scan there is for, the most
    telling first; `why` one clause for the log. `heeds_looks`: the strategy itself does not aim
    again at what was looked at in vain. `worth` is what it expects for the way, in a unit
    of its own; of a place on the way to another one, that one's.
    """

    cell: Cell
    targets: IndexArray
    why: str
    heeds_looks: bool = False
    worth: float = math.inf
