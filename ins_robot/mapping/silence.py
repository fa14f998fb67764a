# SPDX-License-Identifier: MIT
"""How far wide silence is free: a scan in, the way that each silent beam surely had free out.

In a hall wider than the range most beams answer nothing. A wall within the trusted range that
fills a wide angle shows itself somewhere: it is seen squarely at its foot, or goes on from
where readings end beside the run. So a wide run is free up to the trusted range, but not up to
where the walls beside it would go on: those fall silent as they are seen ever more slanted, and
glass between two posts lies on the line of the posts. A scan without any reading may be a blind
sensor and frees nothing here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.messages import LaserScan

READINGS_MIN = 8  # fewer in a whole scan: the sensor may be blind
BESIDE = 8  # readings beside a run that tell where its wall goes on
BESIDE_RAD = math.radians(15.0)  # and how far from the run they may be
END_RAD = math.radians(10.0)  # this near to a reading nothing is free beyond it
CONTINUED_SHARE, CONTINUED_M = 0.9, 0.1  # of the way to a continued wall; less so much
FULL_TURN_SHARE = 0.97


def wide_silence_m(scan: LaserScan, wide_rad: float, trusted_m: float) -> FloatArray:
    """(B,) free way of beams in silent runs at least `wide_rad` wide; 0 for all others."""
    valid, count = scan.is_valid, len(scan.ranges_m)
    free = np.zeros(count)
    if scan.is_free_when_silent or valid.sum() < READINGS_MIN or valid.all():
        return free
    order = np.argsort(scan.bearings_rad, kind="stable")
    bearings, ranges = scan.bearings_rad[order], scan.ranges_m[order]
    span = (bearings[-1] - bearings[0]) * count / max(count - 1, 1)
    is_full = span >= FULL_TURN_SHARE * 2.0 * math.pi
    shift = int(np.flatnonzero(valid[order])[0]) if is_full else 0  # begin with a reading
    index = np.roll(np.arange(count), -shift)
    bearings, ranges = bearings[index], ranges[index]
    silent = ~np.isfinite(ranges)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], silent.astype(np.int8), [0]])))
    points = ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    result = np.zeros(count)
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        run = np.arange(first, end)
        if len(run) * span / count < wide_rad:
            continue
        reach = np.full(len(run), trusted_m)
        for beside in _sides(first, end, count, is_full=is_full):
            near = np.abs(wrap_rad(bearings[beside] - bearings[beside[0]])) <= BESIDE_RAD
            kept = beside[near & ~silent[beside]][:BESIDE]
            if len(kept):
                reach = np.minimum(reach, _before(bearings[run], points[kept]))
        result[run] = reach
    free[order[index]] = np.clip(result, 0.0, None)
    return free


def _sides(first: int, end: int, count: int, *, is_full: bool) -> list[NDArray[np.int64]]:
    """Indices of the beams before and after a run, nearest first, within the sector."""
    most = 4 * BESIDE
    before = np.arange(first - 1, first - 1 - most, -1)
    after = np.arange(end, end + most)
    if is_full:
        return [before % count, after % count]
    return [side for side in (before[before >= 0], after[after < count]) if len(side)]


def _before(bearings_rad: FloatArray, points_m: FloatArray) -> FloatArray:
    """(N,) how far beams (N,) get before the wall through points (K, 2), nearest first."""
    reach = np.full(len(bearings_rad), np.inf)
    end = points_m[0]
    off = np.abs(wrap_rad(bearings_rad - math.atan2(end[1], end[0])))
    nearest_m = float(np.hypot(*points_m.T).min())
    reach[off <= END_RAD] = CONTINUED_SHARE * nearest_m
    if len(points_m) < 3:  # noqa: PLR2004 - two points may be anything
        return reach
    middle = points_m.mean(axis=0)
    spread = points_m - middle
    along = np.linalg.eigh(spread.T @ spread)[1][:, -1]
    normal = np.array([-along[1], along[0]])
    closing = np.cos(bearings_rad) * normal[0] + np.sin(bearings_rad) * normal[1]
    with np.errstate(divide="ignore"):
        crossing = float(middle @ normal) / closing
    ahead = crossing > 0.0
    reach[ahead] = np.minimum(reach[ahead], CONTINUED_SHARE * crossing[ahead] - CONTINUED_M)
    return reach
