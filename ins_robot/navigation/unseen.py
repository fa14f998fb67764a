# SPDX-License-Identifier: MIT
"""The visibility guard's eyes: where the map ends without a wall, and what shows from a place.

An edge is known free ground beside ground that no scan has seen. Unseen specks thinner than
three cells (between beams, before and inside walls) are not worth a visit and are left out, and
so are edges shorter than `exploration.frontier_min_m`. Edges that scans aimed at them did not
move are barren: they are remembered, so that no place is scanned for ever (glass, for one).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.neighbourhood import set_cells
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.ray_cast import cast_rays, cells_on_rays
from ins_robot.navigation.sight import sees

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.int64]
Key = tuple[int, int]  # cell of the lattice of barren edges

SPECK_CELLS = 3  # unseen ground thinner than this is a speck
SIGHT_M = 3.0  # how far beyond an opening its edges may lie
BEHIND_M = 0.2  # and how far on the near side
LOOKS = 48  # edge cells looked at for one opening, evenly drawn
GAIN_RAYS = 180
BARREN_CELL_M = 0.1  # lattice of the memory of barren edges
STRIKES = 2  # scans (or failed drives) without change that make an edge barren


@dataclass(slots=True)
class BarrenEdges:
    """Places whose edges did not move when they were scanned.

    What has become reachable through a narrow passage counts afresh (`where_opened`) for drives
    over that ground: they lead to where none was scanned from before.
    """

    _strikes: Counter[Key] = field(default_factory=Counter)
    _opened_strikes: Counter[Key] = field(default_factory=Counter)
    _pardoned: set[Key] = field(default_factory=set)
    _opened: frozenset[Key] = frozenset()

    def strike(self, points_m: FloatArray, count: int = 1) -> None:
        """Count one more scan in vain for the edges at points (N, 2)."""
        for key in self._keys(points_m):
            counter = self._opened_strikes if key in self._opened else self._strikes
            counter[key] += count

    def refuse(self, points_m: FloatArray) -> None:
        """Count a drive that failed; through a narrow passage none is tried again for them."""
        keys = self._keys(points_m)
        self._strikes.update(keys - self._opened)
        for key in keys & self._opened:
            self._opened_strikes[key] = STRIKES

    def mask(self, points_m: FloatArray) -> BoolArray:
        """(N,) bool: which points are barren."""
        if not (self._strikes or self._opened_strikes):
            return np.zeros(len(points_m), bool)
        return np.array([self._is_barren(self._key(p)) for p in points_m.tolist()], bool)

    def _is_barren(self, key: Key) -> bool:
        counter = self._opened_strikes if key in self._opened else self._strikes
        return counter[key] >= STRIKES

    def where_opened(self, grid: OccupancyGrid, is_near: BoolArray) -> BarrenEdges | None:
        """The same memory, where drives over ground opened in cells (H, W) bool count.

        None where that makes no difference.
        """
        barren = [key for key, count in self._strikes.items() if count >= STRIKES]
        if not barren:
            return None
        cells = grid.cells((np.array(barren) + 0.5) * BARREN_CELL_M)
        inside = grid.contains(cells)
        inside[inside] = is_near[cells[inside, 0], cells[inside, 1]]
        opened = frozenset(key for key, is_in in zip(barren, inside, strict=True) if is_in)
        if all(self._opened_strikes[key] >= STRIKES for key in opened):
            return None
        return replace(self, _opened=opened)

    def pardon_once(self, points_m: FloatArray) -> None:
        """Forget what was counted at points (N, 2), but for those pardoned before."""
        keys = self._keys(points_m)
        for key in keys - self._pardoned:
            self._strikes.pop(key, None)
            self._opened_strikes.pop(key, None)
        self._pardoned |= keys

    def _keys(self, points_m: FloatArray) -> set[Key]:
        return {self._key(point) for point in np.asarray(points_m, float).tolist()}

    @staticmethod
    def _key(point: list[float]) -> Key:
        return math.floor(point[0] / BARREN_CELL_M), math.floor(point[1] / BARREN_CELL_M)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """One decision's view of what is not known.

    Attributes
    ----------
    is_unseen : (H, W) bool
        Without the specks.
    is_opaque : (H, W) bool
        Walls, and the specks between and before their hits.
    cells : (F, 2) int64
        Edge cells.
    points_m : (F, 2) float64
        Their centres, map frame.
    ahead_m : (F, 2) float64
        The unseen ground beside each, a cell ahead: who sees it will have moved the edge.
    edge_of : (F,) int64
        Which connected edge each cell belongs to.
    """

    grid: OccupancyGrid
    is_unseen: BoolArray
    is_opaque: BoolArray
    cells: IndexArray
    points_m: FloatArray
    ahead_m: FloatArray
    edge_of: IndexArray

    def showing_from(
        self,
        places_m: FloatArray,
        middle_m: FloatArray,
        outward: FloatArray | None,
        sight_m: float = SIGHT_M,
    ) -> IndexArray:
        """Indices of edge cells beyond which one sees from any of the places (A, 2).

        With `outward` only those beyond the line through `middle_m` across it.
        """
        away = self.points_m - middle_m
        near = np.hypot(away[:, 0], away[:, 1]) <= sight_m
        if outward is not None:
            near &= away @ outward >= -BEHIND_M
        index = np.flatnonzero(near)
        if len(index) > LOOKS:
            index = index[np.linspace(0, len(index) - 1, LOOKS).astype(np.int64)]
        if len(index) == 0:
            return index
        resolution = self.grid.resolution_m
        origin = np.array(self.grid.origin_m)
        starts = np.asarray((np.asarray(places_m) - origin)[:, ::-1] / resolution)
        ends = np.asarray((self.ahead_m[index] - origin)[:, ::-1] / resolution)
        seen = sees(self.is_opaque, starts, ends)
        return index[seen.any(axis=0)]

    def gain_cells(
        self, cell: tuple[int, int], heading_rad: float, half_rad: float, range_m: float
    ) -> int:
        """How many unseen cells a scan from a cell may show, unseen ground taken as clear."""
        bearings = heading_rad + np.linspace(-half_rad, half_rad, GAIN_RAYS, endpoint=False)
        start = np.array([[cell[0] + 0.5, cell[1] + 0.5]])
        reach = range_m / self.grid.resolution_m
        distance = np.minimum(cast_rays(self.is_opaque, start, bearings, reach), reach)
        flat, _ = cells_on_rays(self.is_opaque.shape, start, bearings, distance)
        height, width = self.is_unseen.shape
        row = start[0, 0] + distance * np.sin(bearings)
        col = start[0, 1] + distance * np.cos(bearings)
        leaves = np.minimum(np.minimum(row, col), np.minimum(height - row, width - col)) < 1.0
        shown = np.unique(flat[self.is_unseen.reshape(-1)[flat]])
        return len(shown) + int(leaves.sum())


def survey_unseen(
    grid: OccupancyGrid,
    edge_min_m: float,
    barren: BarrenEdges,
    is_wanted: BoolArray | None = None,
) -> Unseen:
    """Find the edges of the seen part of a grid; beyond the grid all is unseen."""
    is_unknown, is_occupied = grid.is_unknown, grid.is_occupied
    is_unseen = _open_square(is_unknown, SPECK_CELLS)
    is_behind = is_unknown & _beside(is_occupied, ends=False)
    is_opaque = is_occupied | (is_behind & ~is_unseen)
    is_edge = grid.is_free & _beside(is_unseen, ends=True)
    if is_wanted is not None:
        is_edge &= is_wanted
    cells = set_cells(is_edge)
    dead = barren.mask(_ahead_m(grid, cells, is_unseen))
    is_edge[cells[dead, 0], cells[dead, 1]] = False
    labels, count = label(is_edge, np.ones((3, 3), int))
    sizes = np.bincount(labels.reshape(-1), minlength=count + 1)
    long_enough = sizes * grid.resolution_m >= edge_min_m
    long_enough[0] = False
    cells = set_cells(long_enough[labels])
    return Unseen(
        grid=grid,
        is_unseen=is_unseen,
        is_opaque=is_opaque,
        cells=cells,
        points_m=grid.metres(cells).reshape(-1, 2),
        ahead_m=_ahead_m(grid, cells, is_unseen),
        edge_of=labels[cells[:, 0], cells[:, 1]].astype(np.int64),
    )


def _ahead_m(grid: OccupancyGrid, cells: IndexArray, is_unseen: BoolArray) -> FloatArray:
    """(F, 2) middle of the unseen cells around each edge cell; outside the grid is unseen."""
    padded = np.pad(is_unseen, 1, constant_values=True)
    offsets = np.array([(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c])
    around = cells[:, None] + offsets + 1
    weights = padded[around[..., 0], around[..., 1]].astype(np.float64)
    shift = (weights @ offsets) / np.maximum(weights.sum(axis=1), 1.0)[:, None]
    centres = grid.metres(cells).reshape(-1, 2)
    return np.asarray(centres + shift[:, ::-1] * grid.resolution_m)


def pieces(unseen: Unseen, edge: int, length_m: float) -> list[IndexArray]:
    """Edge cell indices of one edge, cut along its main axis into pieces about this long."""
    index = np.flatnonzero(unseen.edge_of == edge)
    points = unseen.points_m[index] - unseen.points_m[index].mean(axis=0)
    axis = np.linalg.eigh(points.T @ points)[1][:, -1]
    order = np.argsort(points @ axis, kind="stable")
    count = max(1, round(len(index) * unseen.grid.resolution_m / length_m))
    return [np.asarray(index[part]) for part in np.array_split(order, count)]


def _open_square(mask: BoolArray, cells: int) -> BoolArray:
    """Morphological opening with a square; outside the mask counts as set."""
    padded = np.pad(mask, cells, constant_values=True)
    eroded = padded.copy()
    for axis in (0, 1):
        eroded = _window(eroded, cells, axis, np.logical_and)
    opened = np.pad(eroded, [(cells - 1, cells - 1)] * 2, constant_values=False)
    for axis in (0, 1):
        opened = _window(opened, cells, axis, np.logical_or)
    return np.asarray(opened[cells:-cells, cells:-cells])


def _window(mask: BoolArray, cells: int, axis: int, combine: np.ufunc) -> BoolArray:
    """Combine each `cells` neighbours along an axis; the result is shorter by cells - 1."""
    mask = mask if axis == 0 else mask.T
    length = len(mask) - cells + 1
    result = mask[:length]
    for k in range(1, cells):
        result = combine(result, mask[k : k + length])
    return np.asarray(result if axis == 0 else result.T)


def _beside(mask: BoolArray, *, ends: bool) -> BoolArray:
    """Cells that touch a set cell, corners included; `ends`: or the end of the grid."""
    padded = np.pad(mask, 1, constant_values=ends)
    near = padded
    for axis in (0, 1):
        near = _window(near, 3, axis, np.logical_or)
    return near
