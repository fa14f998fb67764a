# SPDX-License-Identifier: MIT
"""Gaps and walls told apart in one scan (the paper's step 02).

A gap is where the scan may be expected to find something new: a run of beams that read longer
than a given length (or nothing, for long enough), or a jump of the range between neighbours,
behind whose nearer edge the scan could not look. Everything else is wall. A gap has two ends,
a width and a centroid, all in the frame of the node the scan was taken at, so that it moves
with the node. Scan in, gaps out; the limits of the sector looked at are no gaps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan

LOST_RAD = math.radians(6.0)  # fewer lost beams in a row than this are drop-outs, not a gap
SPLIT_RAD = math.radians(75.0)  # a wider run is looked at as several gaps side by side
FULL_TURN_RAD = math.radians(359.0)  # a sector this wide has no limits
AHEAD_SHARE = 0.5  # the far end of a gap lies within 60 deg of the line of sight past its edge
BEARING_HOLE = 2.5  # beams this many spacings apart are not neighbours


class GapState(StrEnum):
    """What is known of a gap."""

    UNEXPLORED = "unexplored"
    EXPLORED = "explored"
    TOO_NARROW = "too_narrow"
    UNREACHABLE = "unreachable"
    NO_GO = "no_go"  # in a zone
    OUTSIDE = "outside"  # of boundary or radius
    NOT_WORTH_IT = "not_worth_it"  # too little for the way to it


class GapKind(StrEnum):
    """Where a gap comes from."""

    OPENING = "opening"  # told from a scan
    EDGE = "edge"  # an edge of the seen part of the map (visibility guard)


@dataclass(slots=True, kw_only=True)
class Gap:
    """A gap of one node; mutable in state only.

    Attributes
    ----------
    id : int
        Number among the gaps of its node.
    ends_m : (2, 2) float64
        The two end points (walls, or where the scan's knowledge ends), node frame.
    outward : (2,) float64
        Unit vector through the gap, away from what the scan saw, node frame.
    why : str
        Reason of the state.
    is_deferred : bool
        Refused once; waits until nothing else is left.
    """

    id: int
    ends_m: FloatArray
    outward: FloatArray
    kind: GapKind = GapKind.OPENING
    state: GapState = GapState.UNEXPLORED
    why: str = ""
    is_deferred: bool = False
    failures: int = 0

    @property
    def centroid_m(self) -> FloatArray:
        """(2,) middle of the gap, node frame."""
        return np.asarray(self.ends_m.mean(axis=0))

    @property
    def width_m(self) -> float:
        """Distance between the ends."""
        return float(np.hypot(*(self.ends_m[1] - self.ends_m[0])))

    @property
    def is_open(self) -> bool:
        """Still to be explored."""
        return self.state is GapState.UNEXPLORED

    def set(self, state: GapState, why: str) -> None:
        """Change the state, and say why."""
        self.state, self.why = state, why


@dataclass(frozen=True, slots=True, kw_only=True)
class GapRules:
    """What counts as a gap: see `ExplorationConfig` and `LrfConfig`."""

    gap_range_m: float
    gap_jump_m: float
    range_trusted_m: float
    robot_width_m: float


def find_gaps(
    scan: LaserScan,
    base_from_lrf: Pose2,
    sector: tuple[float, float],
    rules: GapRules,
) -> list[Gap]:
    """Gaps of a scan, in the order of their bearing.

    Parameters
    ----------
    sector : (centre_rad, half_width_rad)
        What was looked at, about the x axis of the base.
    """
    beams = _Beams.of(scan, base_from_lrf, sector, rules)
    if beams.count == 0:
        return []
    found = [*_runs(beams, rules), *_jumps(beams)]
    found.sort(key=lambda item: item[0])
    gaps = [
        Gap(id=number, ends_m=ends, outward=outward)
        for number, (_, ends, outward) in enumerate(found)
    ]
    for gap in gaps:
        if gap.width_m < rules.robot_width_m:
            why = f"{gap.width_m:.2f} m wide, robot {rules.robot_width_m:.2f} m"
            gap.set(GapState.TOO_NARROW, why)
    return gaps


_Found = tuple[int, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Beams:
    """The scan in order of bearing, as the gap rules look at it. B = beams.

    `points_m` (B, 2) are the ends in the base frame, `directions` (B, 2) the unit vectors;
    `reach_m` (B,) is where the ends are: the reading, cut at the gap range; a lost beam reaches
    as far as the sensor is trusted. `is_gap` (B,): part of a run. `run_of` lists (first, last)
    of each run, which may pass the end of the array in a full turn.
    """

    points_m: FloatArray
    directions: FloatArray
    reach_m: FloatArray
    is_gap: NDArray[np.bool_]
    is_wall: NDArray[np.bool_]
    bearings_rad: FloatArray
    spacing_rad: float
    is_full: bool
    jump_m: float

    @property
    def count(self) -> int:
        return len(self.reach_m)

    @staticmethod
    def of(
        scan: LaserScan, base_from_lrf: Pose2, sector: tuple[float, float], rules: GapRules
    ) -> _Beams:
        centre_rad, half_rad = sector
        is_full = 2.0 * half_rad >= FULL_TURN_RAD
        relative = wrap_rad(scan.bearings_rad + (base_from_lrf.heading_rad - centre_rad))
        keep = np.ones(len(relative), bool) if is_full else np.abs(relative) <= half_rad + 1e-9
        order = np.flatnonzero(keep)[np.argsort(relative[keep], kind="stable")]
        bearings = relative[order] + centre_rad
        ranges = scan.ranges_m[order]
        valid = np.isfinite(ranges)
        spacing = float(np.median(np.diff(bearings))) if len(order) > 1 else math.pi
        is_far = valid & (ranges > rules.gap_range_m)
        lost = min(rules.range_trusted_m, rules.gap_range_m)
        reach = np.where(valid, np.minimum(ranges, rules.gap_range_m), lost)
        directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        sensor = np.array([base_from_lrf.x_m, base_from_lrf.y_m])
        is_gap = _without_drop_outs(~valid | is_far, ~valid, spacing, is_full)
        return _Beams(
            points_m=sensor + reach[:, None] * directions,
            directions=directions,
            reach_m=reach,
            is_gap=is_gap,
            is_wall=valid & ~is_gap,
            bearings_rad=bearings,
            spacing_rad=max(spacing, 1e-6),
            is_full=is_full,
            jump_m=rules.gap_jump_m,
        )


def _stretches(mask: NDArray[np.bool_], is_full: bool) -> list[tuple[int, int]]:
    """(first, last) of each run of True; in a full turn a run may pass the array's end."""
    if mask.all():
        return [(0, len(mask) - 1)] if len(mask) else []
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    runs = [(int(a), int(b)) for a, b in zip(first, last, strict=True)]
    if is_full and len(runs) > 1 and mask[0] and mask[-1]:
        runs[-1] = (runs[-1][0], runs[0][1] + len(mask))
        runs = runs[1:]
    return runs


def _without_drop_outs(
    mask: NDArray[np.bool_], lost: NDArray[np.bool_], spacing_rad: float, is_full: bool
) -> NDArray[np.bool_]:
    """Clear the runs that hold nothing but a few lost beams."""
    kept = mask.copy()
    for first, last in _stretches(mask, is_full):
        index = np.arange(first, last + 1) % len(mask)
        if lost[index].all() and len(index) * spacing_rad < LOST_RAD:
            kept[index] = False
    return kept


def _runs(beams: _Beams, rules: GapRules) -> list[_Found]:
    """Gaps from runs of long or lost beams, wide runs cut in parts."""
    found: list[_Found] = []
    for first, last in _stretches(beams.is_gap, beams.is_full):
        is_whole_turn = last - first + 1 == beams.count
        before = first if is_whole_turn else _neighbour(beams, first, -1)
        after = first + beams.count if is_whole_turn else _neighbour(beams, last, +1)
        width_rad = (after - before) * beams.spacing_rad
        parts = max(1, math.ceil(width_rad / SPLIT_RAD))
        cuts = np.linspace(before, after, parts + 1).round().astype(int)
        for a, b in pairwise(cuts.tolist()):
            if b == a:
                continue
            ends = beams.points_m[[a % beams.count, b % beams.count]]
            middle = beams.directions[((a + b) // 2) % beams.count]
            found.append((a % beams.count, ends, _normal(ends, middle)))
    return found


def _neighbour(beams: _Beams, index: int, step: int) -> int:
    """The wall beam beside a run, or the run's own last beam at a limit of the sector."""
    at = index + step
    for _ in range(beams.count):
        if not beams.is_full and not 0 <= at < beams.count:
            return index
        if beams.is_wall[at % beams.count]:
            return at
        if beams.is_gap[at % beams.count]:  # another run begins
            return at - step
        at += step
    return index


def _jumps(beams: _Beams) -> list[_Found]:
    """Gaps where the range jumps between neighbouring wall beams.

    The ends are the nearer edge and, of the farther side, the place nearest to that edge: the
    narrowest way through, whatever the angle it was seen under.
    """
    walls = np.flatnonzero(beams.is_wall)
    if len(walls) < 2:  # noqa: PLR2004 - a jump is between two
        return []
    following = np.roll(walls, -1)
    steps = (following - walls) % beams.count
    hole = steps * beams.spacing_rad
    passed = np.cumsum(beams.is_gap)  # gap beams up to each beam
    between = passed[following] != passed[walls]
    if beams.is_full:  # the last pair passes the array's end
        between[-1] = passed[-1] - passed[walls[-1]] + passed[walls[0]] > 0
    is_pair = ~between & (hole < max(LOST_RAD, BEARING_HOLE * beams.spacing_rad))
    if not beams.is_full:
        is_pair[-1] = False
    delta = beams.reach_m[following] - beams.reach_m[walls]
    is_jump = is_pair & (np.abs(delta) > beams.jump_m)
    found: list[_Found] = []
    for k in np.flatnonzero(is_jump):
        step = 1 if delta[k] > 0.0 else -1  # the far side lies this way round
        near, far = (walls[k], following[k]) if step > 0 else (following[k], walls[k])
        side = _far_side(walls, is_pair & ~is_jump, int(k), step)
        edge = beams.points_m[near]
        radial = beams.directions[far]
        across = beams.points_m[side] - edge
        widths_m = np.hypot(across[:, 0], across[:, 1])
        widths_m[across @ radial < AHEAD_SHARE * widths_m] = np.inf  # what lies before the edge
        ends = np.stack([edge, beams.points_m[side[int(widths_m.argmin())]]])
        into_shadow = step * np.array([radial[1], -radial[0]])  # towards the near wall's back
        found.append((int(near), ends, _normal(ends, into_shadow + 0.3 * radial)))
    return found


def _far_side(
    walls: NDArray[np.int64], is_smooth: NDArray[np.bool_], jump: int, step: int
) -> NDArray[np.int64]:
    """Beams of the wall behind a jump, up to its next gap and no farther than a right angle."""
    count = len(walls)
    at = (jump + 1) % count if step > 0 else jump
    side = [at]
    for _ in range(count // 4):
        link = at if step > 0 else (at - 1) % count
        if not is_smooth[link]:
            break
        at = (at + step) % count
        side.append(at)
    return np.asarray(walls[side])


def _normal(ends_m: FloatArray, towards: FloatArray) -> FloatArray:
    """Unit vector across the segment, on the side of `towards`."""
    along = ends_m[1] - ends_m[0]
    normal = np.array([-along[1], along[0]])
    length = float(np.hypot(*normal))
    if length == 0.0:
        normal, length = towards, float(np.hypot(*towards))
    normal = normal / length
    return normal if float(normal @ towards) >= 0.0 else -normal
