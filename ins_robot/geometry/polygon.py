# SPDX-License-Identifier: MIT
"""Polygons and polylines against many points at once: corners (N, 2) in metres in."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray


def contains(corners_m: FloatArray, points_m: FloatArray) -> NDArray[np.bool_]:
    """(P,) bool: which points (P, 2) lie inside the polygon (even-odd rule)."""
    x, y = np.asarray(points_m, float).T
    inside = np.zeros(len(x), bool)
    for (ax, ay), (bx, by) in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (bx - ax) * (y - ay) / (by - ay))
    return inside


def distance_m(line_m: FloatArray, points_m: FloatArray) -> FloatArray:
    """(P,) distance of points (P, 2) from an open polyline (N, 2), N >= 2."""
    points = np.asarray(points_m, float)
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(line_m):
        along = b - a
        share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        away = points - a - share[:, None] * along
        nearest = np.minimum(nearest, np.hypot(away[:, 0], away[:, 1]))
    return nearest


def outline_m(corners_m: FloatArray) -> FloatArray:
    """(N + 1, 2) the way around, back to the first corner."""
    return np.concatenate([corners_m, corners_m[:1]])
