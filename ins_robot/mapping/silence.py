# SPDX-License-Identifier: MIT
"""What silence means: a scan in, how far the way of each beam without a reading is free out.

Where silence means "nothing there", all of it is. Else beams fall silent at dark, slanted and
far walls, and at glass, and what they say depends on the run of silent beams they stand in:

* narrow: lost readings, or a dark leg, which is no nearer than it would fill the run;
* any: free as far as the nearer of the readings beside it, and never past a bound, as walls
  seen at a grazing angle fall silent too; what lies beyond but within the bound is quiet, if
  the run is not narrow: an open door to a large room, or glass;
* wide, in a hall larger than the range: a wall within the trusted range that fills a wide angle
  shows itself somewhere, seen squarely at its foot, or going on from where readings end beside
  the run. So it is free up to the trusted range, but not up to where the walls beside it would
  go on: those fall silent as they are seen ever more slanted, and glass between two posts lies
  on the line of the posts.

It never goes on beyond a wall that is known: a reading says more than its absence.
A scan with hardly a reading may come from a blind sensor; its silence says nothing at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.messages import LaserScan

NARROW_RAD = math.radians(12.0)
LEG_M = 0.04  # thinner things are not looked for in a narrow run
READINGS_MIN = 8  # fewer in a whole scan: the sensor may be blind
BESIDE = 8  # readings beside a wide run that tell where its wall goes on
BESIDE_RAD = math.radians(15.0)  # and how far from the run they may be
END_RAD = math.radians(10.0)  # this near to a reading nothing is free beyond it
CONTINUED_SHARE, CONTINUED_M = 0.9, 0.1  # of the way to a continued wall; less so much
FULL_TURN_SHARE = 0.97  # bearings that span this share of a turn close on themselves


@dataclass(frozen=True, slots=True, kw_only=True)
class SilenceRules:
    """How far silence is believed: `near_m` in any run, `trusted_m` in one of `wide_rad`.

    `wide_rad` 0: no run is wide.
    """

    near_m: float
    trusted_m: float
    wide_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Silence:
    """The ways (B,) of the beams of a scan as their silence tells them; 0 for readings.

    `free_m` is free, but for walls that are known there already unless `is_proof`;
    `quiet_m` is neither wall nor proved to be free.
    """

    free_m: FloatArray
    quiet_m: FloatArray
    is_proof: bool = False

    def free_before(self, wall_m: FloatArray | None) -> FloatArray:
        """(B,) what is free, where walls are known at `wall_m` (B,); None: nowhere."""
        return self.free_m if wall_m is None else np.minimum(self.free_m, wall_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Runs:
    """Silent runs of a scan: run r is the beams `order[first[r]:end[r]]`, by bearing.

    `nearer_m` (R,) is the nearer of the readings beside it, 0 where the sector ends;
    `width_rad` (R,) the angle between them.
    """

    order: NDArray[np.int64]
    is_full: bool
    first: NDArray[np.int64]
    end: NDArray[np.int64]
    nearer_m: FloatArray
    width_rad: FloatArray


def read_silence(scan: LaserScan, rules: SilenceRules) -> Silence:
    """What the beams without a reading tell."""
    none = np.zeros(len(scan.ranges_m))
    silent = ~scan.is_valid
    if scan.is_free_when_silent:
        return Silence(free_m=np.where(silent, np.inf, 0.0), quiet_m=none, is_proof=True)
    if not silent.any() or np.count_nonzero(scan.is_valid) < READINGS_MIN:
        return Silence(free_m=none, quiet_m=none)
    runs = _silent_runs(scan)
    is_narrow = runs.width_rad < NARROW_RAD
    # Nearer than this a dark leg would hide more beams than fell silent.
    no_leg_m = np.where(is_narrow, LEG_M / np.maximum(runs.width_rad, 1e-6), np.inf)
    free_m, quiet_m = none.copy(), none.copy()
    beams = runs.order[silent[runs.order]]
    lengths = runs.end - runs.first
    reach_m = np.minimum(np.minimum(runs.nearer_m, no_leg_m), rules.near_m)
    free_m[beams] = np.repeat(reach_m, lengths)
    quiet_m[beams] = np.repeat(np.where(is_narrow, 0.0, rules.near_m), lengths)
    return Silence(free_m=np.maximum(free_m, _wide_m(scan, runs, rules)), quiet_m=quiet_m)


def _silent_runs(scan: LaserScan) -> _Runs:
    """Find the runs; those of a whole turn close on themselves."""
    valid, count = scan.is_valid, len(scan.ranges_m)
    order = np.argsort(scan.bearings_rad, kind="stable")
    bearings = scan.bearings_rad[order]
    span = (bearings[-1] - bearings[0]) * count / max(count - 1, 1)
    is_full = bool(span >= FULL_TURN_SHARE * 2.0 * math.pi and valid.any())
    last_rad, last_m = bearings[-1], 0.0
    if is_full:  # begin with a reading, and end with it
        shift = int(np.flatnonzero(valid[order])[0])
        order = np.roll(order, -shift)
        bearings = np.concatenate([bearings[shift:], bearings[:shift] + 2.0 * math.pi])
        last_rad, last_m = bearings[0] + 2.0 * math.pi, scan.ranges_m[order[0]]
    silent = np.concatenate([[False], ~valid[order], [False]])
    edges = np.flatnonzero(silent[1:] != silent[:-1])
    first, end = edges[::2], edges[1::2]
    bounds = np.concatenate([bearings[:1], bearings, [last_rad]])
    ranges = np.concatenate([[0.0], scan.ranges_m[order], [last_m]])
    return _Runs(
        order=order,
        is_full=is_full,
        first=first,
        end=end,
        nearer_m=np.minimum(ranges[first], ranges[end + 1]),
        width_rad=bounds[end + 1] - bounds[first],
    )


def _wide_m(scan: LaserScan, runs: _Runs, rules: SilenceRules) -> FloatArray:
    """(B,) free way of beams in wide runs; 0 for all others."""
    free_m = np.zeros(len(scan.ranges_m))
    is_wide = runs.width_rad >= rules.wide_rad
    if rules.wide_rad <= 0.0 or not is_wide.any():
        return free_m
    bearings, ranges = scan.bearings_rad[runs.order], scan.ranges_m[runs.order]
    points = ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    for first, end in zip(runs.first[is_wide], runs.end[is_wide], strict=True):
        reach = np.full(end - first, rules.trusted_m)
        for beside in _sides(int(first), int(end), len(ranges), is_full=runs.is_full):
            near = np.abs(wrap_rad(bearings[beside] - bearings[beside[0]])) <= BESIDE_RAD
            kept = beside[near & np.isfinite(ranges[beside])][:BESIDE]
            if len(kept):
                reach = np.minimum(reach, _before(bearings[first:end], points[kept]))
        free_m[runs.order[first:end]] = np.clip(reach, 0.0, None)
    return free_m


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
