# SPDX-License-Identifier: MIT
"""Outlines that people give (boundary, no-go zones): corners in, what is wrong with them out.

Plain Python on purpose: the configuration and the command line check outlines before anything
heavy is imported. `geometry/polygon.py` has the same for many points at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

Point = tuple[float, float]
Corners = tuple[Point, ...]

CORNERS_MIN, CORNERS_MAX = 3, 200  # every side is held against every other
COORDINATE_MAX_M = 1000.0  # from the start: no map gets there
AREA_MIN_M2 = 1e-4


def flaw_of(corners_m: Sequence[Point]) -> str | None:
    """What keeps corners from being a polygon, in words; None: nothing."""
    count = len(corners_m)
    if count < CORNERS_MIN:
        return f"{count} corners, a polygon needs at least {CORNERS_MIN}"
    if count > CORNERS_MAX:
        return f"{count} corners, at most {CORNERS_MAX} are allowed: leave out the finest"
    if not all(abs(v) <= COORDINATE_MAX_M for corner in corners_m for v in corner):
        return f"it reaches further than {COORDINATE_MAX_M:g} m from the start"
    sides = list(zip(corners_m, [*corners_m[1:], corners_m[0]], strict=True))
    for i, j in combinations(range(count), 2):
        is_beside = j == i + 1 or (i == 0 and j == count - 1)
        if _folds(sides[i], sides[j]) if is_beside else _meet(sides[i], sides[j]):
            return f"it crosses itself: its sides {i + 1} and {j + 1} meet"
    area = 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in sides)
    if abs(area) < AREA_MIN_M2:
        return "it has no area"
    return None


def is_inside(corners_m: Sequence[Point], point_m: Point) -> bool:
    """Whether a point lies inside (even-odd rule)."""
    x, y = point_m
    inside = False
    for (ax, ay), (bx, by) in zip(corners_m, [*corners_m[1:], corners_m[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (bx - ax) * (y - ay) / (by - ay):
            inside = not inside
    return inside


_Side = tuple[Point, Point]


def _turn(a: Point, b: Point, c: Point) -> float:
    """Positive when c lies to the left of the way from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _meet(one: _Side, other: _Side) -> bool:
    """Whether two sides have a point in common, touching included."""
    (a, b), (c, d) = one, other
    turns = (_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b))
    if turns[0] * turns[1] < 0.0 and turns[2] * turns[3] < 0.0:
        return True
    ends = ((one, c), (one, d), (other, a), (other, b))
    return any(turn == 0.0 and _is_on(*end) for turn, end in zip(turns, ends, strict=True))


def _is_on(side: _Side, point: Point) -> bool:
    """Whether a point in line with a side lies on it."""
    return all(
        min(a, b) <= value <= max(a, b) for a, b, value in zip(*side, point, strict=True)
    )


def _folds(one: _Side, other: _Side) -> bool:
    """Whether neighbouring sides run back over one another."""
    if one[0] == other[1] and one[1] != other[0]:  # the first side and the last one
        one, other = other, one
    (a, b), (_, d) = one, other
    back = (a[0] - b[0]) * (d[0] - b[0]) + (a[1] - b[1]) * (d[1] - b[1])
    return _turn(a, b, d) == 0.0 and back >= 0.0
