# SPDX-License-Identifier: MIT
"""Features: points of a scan that stay put when the robot moves. A scan in, points out.

The range signal is differentiated by bearing (the paper's figure 7). A falling and a rising
edge enclose an object; the near side of a single edge is the end of a wall; where the slope
itself breaks, two walls meet in a corner. Ends and corners are read off lines fitted to the
readings beside them, so their covariance (2, 2) is that of the fits and of the beam spacing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.line_fits import LineFits, intersect
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.messages import LaserScan

EDGE_M = 0.15  # a step of the range signal beyond this ...
EDGE_SLOPE = 2.0  # ... plus that of a wall seen at 63 deg from its normal is an edge
GAP_MAX_RAD = math.radians(6.5)  # readings further apart say nothing of what is between them
WINDOWS_M = (0.2, 0.4, 0.8, 1.2)  # lengths of the lines that are fitted; the longest good one
WINDOW_MIN, WINDOW_MAX = 4, 40  # ... in readings on one side
CORNER_SIN_MIN = math.sin(math.radians(35.0))
CORNER_APART_M = 0.3  # of two corners nearer than this one is left
OBJECT_WIDTH_MAX_M = 0.35
OBJECT_READINGS_MIN = 2
OBJECT_STD_SHARE = 0.25  # of its width: what its middle wanders with the side it is seen from
ROUND_DEPTH = 0.39  # of its width: the middle of a round thing lies this far behind its face
GRAZING_SIN = 0.15  # a line seen flatter than this ends anywhere
OFF_LINE_M = 0.15  # what goes on behind an edge in the same line is the same wall
STD_MIN_M = 0.01
HEADING_STD_MIN_RAD = math.radians(1.0)
NO_HEADING_VAR = 100.0


class FeatureKind(IntEnum):
    """What a feature is; only the same kinds are taken for the same thing.

    A corner that stands out is a wall end from where one of its sides is hidden; a map then
    has it twice.
    """

    INNER_CORNER = 0
    OUTER_CORNER = 1
    WALL_END = 2
    OBJECT = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """F features in one frame.

    Attributes
    ----------
    points_m : (F, 2)
    covariances : (F, 2, 2)
    kinds : (F,) int64
        Values of `FeatureKind`.
    headings_rad, heading_vars : (F,)
        Where it points, with its variance: a corner between its walls, an end into its wall;
        an object nowhere, its variance is NO_HEADING_VAR.
    """

    points_m: FloatArray
    covariances: FloatArray
    kinds: IntArray
    headings_rad: FloatArray
    heading_vars: FloatArray

    def __len__(self) -> int:
        return len(self.points_m)

    def at(self, pose: Pose2) -> Features:
        """The same features carried by a pose into the frame on the left of its name."""
        c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
        turn = np.array([[c, -s], [s, c]])
        return Features(
            points_m=pose.apply(self.points_m),
            covariances=turn @ self.covariances @ turn.T,
            kinds=self.kinds,
            headings_rad=wrap_rad(self.headings_rad + pose.heading_rad),
            heading_vars=self.heading_vars,
        )

    def take(self, index: IntArray | BoolArray) -> Features:
        """A part of them."""
        return Features(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def features_of_scan(scan: LaserScan, bearing_std_rad: float, reach_max_m: float) -> Features:
    """Features in the LRF frame; readings beyond `reach_max_m` are left out."""
    if np.count_nonzero(scan.ranges_m <= reach_max_m) < 2 * WINDOW_MIN:
        return _joined([])
    signal = _Signal(scan, bearing_std_rad, reach_max_m)
    objects, is_in_object = _objects(signal)
    ends = _wall_ends(signal, is_in_object)
    corners = _corners(signal, is_in_object)
    return _joined([objects, ends, corners])


class _Signal:
    """The range signal by bearing, its edges, and the lines before and after each reading.

    A full turn is repeated at both ends by one window; `is_core` (B,) marks the turn itself.
    """

    def __init__(self, scan: LaserScan, bearing_std_rad: float, reach_max_m: float) -> None:
        used = np.flatnonzero(np.nan_to_num(scan.ranges_m, nan=np.inf) <= reach_max_m)
        bearings = np.mod(scan.bearings_rad[used] + math.pi, 2.0 * math.pi) - math.pi
        order = np.argsort(bearings, kind="stable")
        used, bearings = used[order], bearings[order]
        count = len(used)
        pad = 0
        if count and bearings[0] + 2.0 * math.pi - bearings[-1] < GAP_MAX_RAD:
            pad = min(2 * WINDOW_MAX, count)
        index = np.arange(-pad, count + pad)
        wrapped = index % max(count, 1)
        self.is_core = (index >= 0) & (index < count)
        self.bearings_rad = bearings[wrapped] + 2.0 * math.pi * (
            (index - wrapped) / max(count, 1)
        )
        self.ranges_m = scan.ranges_m[used][wrapped]
        self.rays = np.stack([np.cos(self.bearings_rad), np.sin(self.bearings_rad)], axis=-1)
        self.points_m = self.ranges_m[:, None] * self.rays
        self.range_var_m2 = scan.range_std_m[used][wrapped] ** 2
        self.bearing_var = bearing_std_rad**2
        # link i is between reading i and i + 1
        self.gaps_rad = np.diff(self.bearings_rad)
        self.step_rad = float(np.median(self.gaps_rad)) if count > 1 else 1.0
        rise_m = np.diff(self.ranges_m)
        nearer_m = np.minimum(self.ranges_m[:-1], self.ranges_m[1:])
        is_known = self.gaps_rad < GAP_MAX_RAD
        is_edge = np.abs(rise_m) > EDGE_M + EDGE_SLOPE * nearer_m * self.gaps_rad
        self.rises = is_known & is_edge & (rise_m > 0.0)  # (B - 1,)
        self.falls = is_known & is_edge & (rise_m < 0.0)
        self.is_broken = is_edge | ~is_known
        self._fit_lines()

    def _fit_lines(self) -> None:
        segment = np.concatenate([[0], np.cumsum(self.is_broken)])
        self.first = np.searchsorted(segment, segment, side="left")  # (B,) of each's segment
        self.last = np.searchsorted(segment, segment, side="right") - 1
        here = np.arange(len(segment))
        steps_m = np.hypot(*np.diff(self.points_m, axis=0).T)
        arc_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        noise = self.range_var_m2
        lines: list[tuple[LineFits, LineFits]] = []
        for length_m in WINDOWS_M:
            start = np.searchsorted(arc_m, arc_m - length_m, side="left")
            stop = np.searchsorted(arc_m, arc_m + length_m, side="right") - 1
            start = np.clip(start, here - WINDOW_MAX, here - WINDOW_MIN)
            stop = np.clip(stop, here + WINDOW_MIN, here + WINDOW_MAX)
            before = LineFits.of_windows(
                self.points_m, noise, np.maximum(start, self.first), here
            )
            after = LineFits.of_windows(self.points_m, noise, here, np.minimum(stop, self.last))
            lines.append((before, after))
        self.before, self.after = lines[0]
        for before, after in lines[1:]:
            self.before = before.or_else(before.is_good, self.before)
            self.after = after.or_else(after.is_good, self.after)


def _objects(signal: _Signal) -> tuple[Features, BoolArray]:
    """Narrow things between a falling and a rising edge, and (B,) the readings on them."""
    starts = np.flatnonzero(signal.falls) + 1
    starts = starts[signal.last[starts] < len(signal.ranges_m) - 1]
    stops = signal.last[starts]
    width_m = np.hypot(*(signal.points_m[stops] - signal.points_m[starts]).T)
    width_m = width_m + signal.ranges_m[starts] * signal.step_rad
    count = stops - starts + 1
    is_object = signal.rises[stops] & (width_m < OBJECT_WIDTH_MAX_M)
    is_object &= count >= OBJECT_READINGS_MIN
    starts, stops, width_m, count = (a[is_object] for a in (starts, stops, width_m, count))
    middle = 0.5 * (signal.points_m[starts] + signal.points_m[stops])
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(signal.points_m, axis=0)])
    mean = (sums[stops + 1] - sums[starts]) / count[:, None]
    rays = middle / np.hypot(*middle.T)[:, None]
    depth = (mean * rays).sum(axis=1) + ROUND_DEPTH * width_m
    spacing_m = signal.ranges_m[starts] * signal.step_rad
    var = (OBJECT_STD_SHARE * width_m) ** 2 + spacing_m**2 / 12.0 + STD_MIN_M**2
    var += signal.range_var_m2[starts] / count
    is_in = np.zeros(len(signal.ranges_m) + 1, dtype=np.int64)
    np.add.at(is_in, starts, 1)
    np.add.at(is_in, stops + 1, -1)
    features = Features(
        points_m=rays * depth[:, None],
        covariances=var[:, None, None] * np.eye(2),
        kinds=np.full(len(starts), int(FeatureKind.OBJECT)),
        headings_rad=np.zeros(len(starts)),
        heading_vars=np.full(len(starts), NO_HEADING_VAR),
    ).take(signal.is_core[starts])
    return features, np.cumsum(is_in)[:-1] > 0


def _wall_ends(signal: _Signal, is_in_object: BoolArray) -> Features:
    """Near sides of edges at which a line ends."""
    near = np.concatenate([np.flatnonzero(signal.rises), np.flatnonzero(signal.falls) + 1])
    rising = np.arange(len(near)) < signal.rises.sum()
    far = np.where(rising, near + 1, near - 1)
    lines = signal.before.take(np.where(rising, near, 0)).or_else(
        rising, signal.after.take(np.where(rising, 0, near))
    )
    ray, point = signal.rays[near], signal.points_m[near]
    sin_seen = np.abs(lines.directions[:, 0] * ray[:, 1] - lines.directions[:, 1] * ray[:, 0])
    gap_rad = np.abs(signal.bearings_rad[far] - signal.bearings_rad[near])
    is_end = lines.is_good & ~is_in_object[near] & signal.is_core[near]
    is_end &= sin_seen > GRAZING_SIN
    is_end &= np.abs(lines.distances_m(signal.points_m[far])) > OFF_LINE_M
    is_end &= np.abs(lines.distances_m(point)) < 3.0 * np.sqrt(lines.var_m2)
    lines = lines.take(is_end)
    near, gap_rad, sin_seen, ray = near[is_end], gap_rad[is_end], sin_seen[is_end], ray[is_end]
    # the wall ends somewhere between two beams: half a beam on, give or take
    beyond_m = signal.ranges_m[near] * gap_rad / sin_seen
    outward = signal.points_m[near] - lines.centres_m
    along = lines.directions * np.sign((lines.directions * outward).sum(axis=1))[:, None]
    at_m = (along * outward).sum(axis=1) + 0.5 * beyond_m
    aside_var = (signal.ranges_m[near] / sin_seen) ** 2 * signal.bearing_var
    along_var = beyond_m**2 / 12.0 + aside_var + STD_MIN_M**2
    across_var = lines.var_at(at_m) + STD_MIN_M**2
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    covariances = along_var[:, None, None] * (along[:, :, None] * along[:, None, :])
    covariances += across_var[:, None, None] * (normal[:, :, None] * normal[:, None, :])
    return Features(
        points_m=lines.centres_m + along * at_m[:, None],
        covariances=covariances,
        kinds=np.full(len(near), int(FeatureKind.WALL_END)),
        headings_rad=np.arctan2(-along[:, 1], -along[:, 0]),
        heading_vars=lines.heading_vars + HEADING_STD_MIN_RAD**2,
    )


def _corners(signal: _Signal, is_in_object: BoolArray) -> Features:
    """Where two lines meet at an angle, with readings of both up to the corner."""
    link = np.flatnonzero(~signal.is_broken & ~is_in_object[:-1] & signal.is_core[:-1])
    one, other = signal.before.take(link), signal.after.take(link + 1)
    points, covariances, sin_between = intersect(one, other, STD_MIN_M)
    spacing_m = np.hypot(*(signal.points_m[link + 1] - signal.points_m[link]).T)
    reach_m = 0.05 + 1.5 * spacing_m
    is_corner = one.is_good & other.is_good & (np.abs(sin_between) > CORNER_SIN_MIN)
    for end in (link, link + 1):
        is_corner &= np.hypot(*(signal.points_m[end] - points).T) < reach_m
    kept = np.flatnonzero(is_corner)
    misfit = one.var_m2 * one.counts + other.var_m2 * other.counts
    kept = kept[np.argsort(misfit[kept], kind="stable")]
    best: list[int] = []
    for k in kept.tolist():  # a handful: the best fit first, its neighbours dropped
        if all(math.dist(points[k], points[b]) > CORNER_APART_M for b in best):
            best.append(k)
    chosen = np.array(best, dtype=np.int64)
    points, covariances = points[chosen], covariances[chosen]
    one, other = one.take(chosen), other.take(chosen)
    between = one.away_from(points) + other.away_from(points)
    is_inner = (between * points).sum(axis=1) < 0.0
    return Features(
        points_m=points,
        covariances=covariances,
        kinds=np.where(is_inner, int(FeatureKind.INNER_CORNER), int(FeatureKind.OUTER_CORNER)),
        headings_rad=np.arctan2(between[:, 1], between[:, 0]),
        heading_vars=0.25 * (one.heading_vars + other.heading_vars) + HEADING_STD_MIN_RAD**2,
    )


def _joined(parts: list[Features]) -> Features:
    return Features(
        points_m=np.concatenate([np.zeros((0, 2)), *(p.points_m for p in parts)]),
        covariances=np.concatenate([np.zeros((0, 2, 2)), *(p.covariances for p in parts)]),
        kinds=np.concatenate([np.zeros(0, dtype=np.int64), *(p.kinds for p in parts)]),
        headings_rad=np.concatenate([np.zeros(0), *(p.headings_rad for p in parts)]),
        heading_vars=np.concatenate([np.zeros(0), *(p.heading_vars for p in parts)]),
    )
