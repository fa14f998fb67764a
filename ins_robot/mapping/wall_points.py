# SPDX-License-Identifier: MIT
"""Where the walls are, finer than a grid's cells: near readings in, points on surfaces out.

A cell is solid or free; a wall runs somewhere through it, and a leg that fills half of a cell
may lose that cell to the beams that pass beside it. In a doorway the robot has less room than
that. Readings from near know the surface to some millimetres; the nearer one counts.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.neighbourhood import grown
from ins_robot.messages import LaserScan

RINGS_M = (0.5, 1.0, 2.0)  # the nearer ring tells of a surface before the next
SAME_M = 0.05  # a reading from further this near to one from nearer adds nothing but its noise
NEARER_SHARE = 0.5  # and only then: what one scan saw of one surface is not told apart
ALONE_M, ALONE_RAD = 0.01, 0.035  # no other so near, or within two beams: a ghost
CROSSED_ALONE_M = 0.03  # ... where beams have passed: what is there is seen more than once
TILE_M = 3.2  # edge of the squares in which readings are kept
THIN_M = 0.01  # one reading per square of this size is enough

BoolArray = NDArray[np.bool_]


_Readings = tuple[FloatArray, FloatArray, NDArray[np.int64]]


class NearReadings:
    """End points of near readings in the map frame: the nearest one of each small square.

    Kept in tiles, so that neither adding nor asking costs what is known elsewhere.
    """

    def __init__(self) -> None:
        self._tiles: dict[tuple[int, int], _Readings] = {}
        self._new: list[tuple[LaserScan, Pose2]] = []

    def add(self, scan: LaserScan, map_from_lrf: Pose2) -> None:
        """Take a scan in, taken at `map_from_lrf`; it is looked at when asked for."""
        self._new.append((scan, map_from_lrf))

    def within(self, low_m: FloatArray, high_m: FloatArray) -> _Readings:
        """(N, 2) end points, (N,) the ranges they were seen from, and (N,) how often.

        All of a box from `low_m` (2,) to `high_m` (2,), and some around.
        """
        self._take_in()
        first, last = (np.floor(m / TILE_M).astype(int).tolist() for m in (low_m, high_m))
        found = [_NONE]
        for key in product(range(first[0], last[0] + 1), range(first[1], last[1] + 1)):
            if key in self._tiles:
                found.append(self._tiles[key])
        points, ranges, counts = zip(*found, strict=True)
        return np.concatenate(points), np.concatenate(ranges), np.concatenate(counts)

    def _take_in(self) -> None:
        """Sort new readings into their tiles."""
        if not self._new:
            return
        seen = [_near_ends(scan, map_from_lrf) for scan, map_from_lrf in self._new]
        self._new.clear()
        points = np.concatenate([points for points, _ in seen])
        ranges = np.concatenate([ranges for _, ranges in seen])
        tiles = np.floor(points / TILE_M).astype(np.int64)
        keys, of = np.unique(tiles, axis=0, return_inverse=True)
        for number, (i, j) in enumerate(keys.tolist()):
            new = np.flatnonzero(of.reshape(-1) == number)
            old = self._tiles.get((i, j), _NONE)
            self._tiles[i, j] = _thinned(
                np.concatenate([old[0], points[new]]),
                np.concatenate([old[1], ranges[new]]),
                np.concatenate([old[2], np.ones(len(new), np.int64)]),
            )


_NONE: _Readings = (np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))


def _thinned(points: FloatArray, ranges: FloatArray, counts: NDArray[np.int64]) -> _Readings:
    """Of each small square the nearest reading, with all that are counted there."""
    squares = np.floor(points / THIN_M).astype(np.int64)
    order = np.lexsort((ranges, squares[:, 1], squares[:, 0]))
    squares = squares[order]
    first = np.ones(len(order), bool)
    first[1:] = (squares[1:] != squares[:-1]).any(axis=1)
    kept = order[first]
    counts = counts.copy()
    counts[kept] = np.add.reduceat(counts[order], np.flatnonzero(first))
    kept = np.sort(kept)
    return points[kept], ranges[kept], counts[kept]


def _near_ends(scan: LaserScan, map_from_lrf: Pose2) -> tuple[FloatArray, FloatArray]:
    """(N, 2) map-frame ends and (N,) ranges of a scan's near readings."""
    near = np.nan_to_num(scan.ranges_m, nan=np.inf) <= RINGS_M[-1]
    ranges, bearings = scan.ranges_m[near], scan.bearings_rad[near]
    ends = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
    return map_from_lrf.apply(ends), ranges


def wall_points(
    points_m: FloatArray,
    ranges_m: FloatArray,
    counts: NDArray[np.int64],
    cells: NDArray[np.int64],
    is_occupied: BoolArray,
    is_crossed: BoolArray,
) -> tuple[FloatArray, BoolArray]:
    """The readings that count: (M, 2) points on surfaces, and (H, W) the cells beside them.

    Parameters
    ----------
    points_m, ranges_m, counts : (N, 2), (N,), (N,)
        End points, how far away they were, and how often they were seen.
    cells : (N, 2) int64
        The grid's cell of each; one that is not in or beside an occupied cell is a ghost, and
        so is one alone in a cell that is not occupied: the mixed reading of two surfaces.
        Alone is farther from the next than two beams are apart; in a crossed cell than 3 cm.
    is_occupied, is_crossed : (H, W) bool
        Solid cells, and those that beams have passed through again and again.
    """
    if len(points_m) == 0:
        return points_m, np.zeros(is_occupied.shape, bool)
    from scipy.spatial import cKDTree

    beside = grown(is_occupied)
    real = beside[cells[:, 0], cells[:, 1]]
    points_m, ranges_m, counts, cells = (
        points_m[real],
        ranges_m[real],
        counts[real],
        cells[real],
    )
    rows, cols = cells.T
    apart_m = ALONE_M + ALONE_RAD * ranges_m
    apart_m = np.where(is_crossed[rows, cols], np.minimum(apart_m, CROSSED_ALONE_M), apart_m)
    real = (counts > 1) | is_occupied[rows, cols] | (_next_m(points_m) <= apart_m)
    points_m, ranges_m, cells = points_m[real], ranges_m[real], cells[real]
    is_told = np.zeros(len(points_m), bool)
    nearer_m = 0.0
    for ring_m in RINGS_M:
        ring = np.flatnonzero((ranges_m > nearer_m) & (ranges_m <= ring_m))
        known = np.flatnonzero(is_told)
        if len(known):
            away, nearest = cKDTree(points_m[known]).query(points_m[ring])
            nearer = ranges_m[known[nearest]] <= NEARER_SHARE * ranges_m[ring]
            ring = ring[~(nearer & (away <= SAME_M))]
        is_told[ring] = True
        nearer_m = ring_m
    told = np.zeros(is_occupied.shape, bool)
    told[cells[is_told, 0], cells[is_told, 1]] = True
    return points_m[is_told], grown(told)


def _next_m(points_m: FloatArray) -> FloatArray:
    """(N,) how far the nearest other one of points (N, 2) is."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(points_m).query(points_m, k=2)[0][:, 1])
