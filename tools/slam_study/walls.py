# SPDX-License-Identifier: MIT
"""Straight walls found in a cloud of returns, and how far returns lie from their wall.

Greedy Hough: the strongest line, cut where it has gaps, each piece fitted by total least
squares. What lies within `GATE_M` of walls belongs to the nearest, and no second wall is looked
for there: a wall seen twice at two places is one thick wall and not two thin ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray

ANGLES_RAD = np.radians(np.arange(0.0, 180.0, 1.0))
BIN_M = 0.04
THIN_M = 0.02  # returns closer together vote once
VOTES_MIN = 40
GATE_M = 0.2
SINE_MAX = 0.4
FIT_M = 0.06  # only what is this near pulls at the line
GAP_M = 0.3
LENGTH_MIN_M = 0.8
WALLS_MAX = 150
FITS = 4


@dataclass(frozen=True)
class Wall:
    """A piece of wall from `low_m` to `high_m` along `direction`, seen from `centre_m`."""

    centre_m: FloatArray
    direction: FloatArray
    low_m: float
    high_m: float

    def distances_m(self, points_m: FloatArray, beyond_m: float = 0.0) -> FloatArray:
        """(N,) distances of points (N, 2); inf for others. Its ends may lie further out."""
        off = points_m - self.centre_m
        along = off @ self.direction
        distance = np.abs(off @ np.array([-self.direction[1], self.direction[0]]))
        is_beside = (along >= self.low_m - beyond_m) & (along <= self.high_m + beyond_m)
        is_own = is_beside & (distance < GATE_M)
        return np.where(is_own, distance, np.inf)


def distances_to_walls_m(points_m: FloatArray, normals: FloatArray) -> FloatArray:
    """(M,) distances of those of the points (N, 2) that belong to a wall, the nearest one.

    What faces elsewhere than the wall, by its own neighbours' `normals` (N, 2), is not of it.
    """
    left = points_m
    nearest = np.full(len(points_m), np.inf)
    is_dead: set[tuple[int, int]] = set()
    for _ in range(WALLS_MAX):
        angle, rho_bin = _strongest(left, is_dead)
        if angle is None:
            break
        found = _walls_along(left, ANGLES_RAD[angle], (rho_bin + 0.5) * BIN_M)
        if not found:
            is_dead.add((angle, rho_bin))
        for wall in found:
            left = left[~np.isfinite(wall.distances_m(left))]
            # into corners, which the wall found first has taken
            distance_m = wall.distances_m(points_m, GATE_M)
            faces_away = np.abs(normals @ wall.direction) > SINE_MAX
            nearest = np.minimum(nearest, np.where(faces_away, np.inf, distance_m))
        if len(left) < VOTES_MIN:
            break
    return nearest[np.isfinite(nearest)]


def _strongest(points_m: FloatArray, is_dead: set[tuple[int, int]]) -> tuple:
    """(angle, bin of rho) with the most votes; (None, None) when none has enough."""
    cells = np.unique(np.floor(points_m / THIN_M).astype(np.int64), axis=0)
    voters = (cells + 0.5) * THIN_M
    rho = voters @ np.stack([np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)])  # (V, A)
    bins = np.floor(rho / BIN_M).astype(np.int64)
    low = int(bins.min())
    width = int(bins.max()) - low + 1
    flat = (bins - low + np.arange(len(ANGLES_RAD)) * width).reshape(-1)
    votes = np.bincount(flat, minlength=width * len(ANGLES_RAD)).reshape(-1, width)
    for angle, rho_bin in is_dead:
        if 0 <= rho_bin - low < width:
            votes[angle, rho_bin - low] = 0
    best = int(votes.argmax())
    if votes.reshape(-1)[best] < VOTES_MIN:
        return None, None
    return best // width, best % width + low


def _walls_along(points_m: FloatArray, angle_rad: float, rho_m: float) -> list[Wall]:
    """Pieces of wall on a line."""
    normal = np.array([math.cos(angle_rad), math.sin(angle_rad)])
    direction = np.array([-normal[1], normal[0]])
    core = points_m[np.abs(points_m @ normal - rho_m) < BIN_M]
    along = core @ direction
    order = np.argsort(along, kind="stable")
    cuts = np.flatnonzero(np.diff(along[order]) > GAP_M) + 1
    found = []
    for piece in np.split(order, cuts):
        if len(piece) >= VOTES_MIN and np.ptp(along[piece]) >= LENGTH_MIN_M:
            found.append(_fitted(points_m, core[piece]))
    return found


def _fitted(points_m: FloatArray, members_m: FloatArray) -> Wall:
    """The line through a piece, what belongs to it, and the line through that, in turn."""
    for _ in range(FITS):
        centre = np.median(members_m, axis=0)
        off = members_m - centre
        direction = np.linalg.eigh(off.T @ off)[1][:, 1]
        along = off @ direction
        wall = Wall(centre, direction, float(along.min()), float(along.max()))
        members_m = points_m[wall.distances_m(points_m) < FIT_M]
    return wall
