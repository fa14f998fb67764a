# SPDX-License-Identifier: MIT
"""Surfels: scan points with the normal of the surface they lie on. A scan in, surfels out.

Neighbouring readings vote for the line through each point (principal axes in closed form).
Where they agree the point is flat and only its distance along the normal means anything;
elsewhere (a leg, an edge) it is round and counts in both directions, with less weight. The
noise is that of a range and a bearing with Gaussian errors, seen along the normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.messages import LaserScan

NEIGHBOURS_PER_SIDE = 3
VOTER_SPACING_M = 0.05
STRIDE_MAX = 8
REACH_M = 0.12  # neighbours further away than this, plus a share of the range, do not vote
REACH_PER_M = 0.045
FLAT_RATIO = 0.12  # across / along spread below which a neighbourhood is a line
NOISE_FACTOR = 2.0  # the spread of six voters is often this much over their variance
NOISE_RATIO = 0.32  # a line is at least this much longer than its noise is wide
VOTES_MIN = 2
TILT_STD_MIN_RAD = 0.01
ROUND_STD_M = 0.05  # an edge looks elsewhere from elsewhere


@dataclass(frozen=True, slots=True, kw_only=True)
class Surfels:
    """Surface elements in one frame.

    Attributes
    ----------
    points_m : (N, 2)
    normals : (N, 2)
        Unit vectors towards the side that was seen from; of round ones straight to the viewer.
    is_flat : (N,) bool
        False: a round thing or an edge, without a direction to slide along.
    std_m : (N,)
        Standard deviation along the normal (for round ones: in every direction).
    tilt_std_rad : (N,)
        Standard deviation of the normal's direction; 0 for round ones, which have none.
    is_lone : (N,) bool
        Without neighbours, often the last reading of a wall seen at a slant; or round, where a
        surface comes out from behind a nearer one. Its place moves with the robot: it may lie
        on a map, but is no map, and no edge.
    sources : (N,) int64
        Node each surfel was seen from; -1 for a scan that is no node (yet).
    """

    points_m: FloatArray
    normals: FloatArray
    is_flat: BoolArray
    std_m: FloatArray
    tilt_std_rad: FloatArray
    is_lone: BoolArray
    sources: IntArray

    def __len__(self) -> int:
        return len(self.points_m)

    def at(self, pose: Pose2) -> Surfels:
        """The same surfels carried by a pose into the frame on the left of its name."""
        turned = Pose2(0.0, 0.0, pose.heading_rad)
        return Surfels(
            points_m=pose.apply(self.points_m),
            normals=turned.apply(self.normals),
            is_flat=self.is_flat,
            std_m=self.std_m,
            tilt_std_rad=self.tilt_std_rad,
            is_lone=self.is_lone,
            sources=self.sources,
        )

    def take(self, index: IntArray | BoolArray) -> Surfels:
        """A part of them."""
        rows = np.flatnonzero(index) if index.dtype == np.bool_ else index
        return Surfels(
            points_m=self.points_m.take(rows, axis=0),
            normals=self.normals.take(rows, axis=0),
            is_flat=self.is_flat.take(rows),
            std_m=self.std_m.take(rows),
            tilt_std_rad=self.tilt_std_rad.take(rows),
            is_lone=self.is_lone.take(rows),
            sources=self.sources.take(rows),
        )

    def seen_by(self, node_id: int) -> Surfels:
        """The same surfels as those of one node."""
        return Surfels(
            points_m=self.points_m,
            normals=self.normals,
            is_flat=self.is_flat,
            std_m=self.std_m,
            tilt_std_rad=self.tilt_std_rad,
            is_lone=self.is_lone,
            sources=np.full(len(self), node_id),
        )

    def spread_out(self, spacing_m: float, count_max: int) -> Surfels:
        """At most one surfel per cell of that spacing, and at most so many."""
        cells = np.floor(self.points_m / spacing_m).astype(np.int64)
        _, first = np.unique(cells[:, 0] * 1_000_003 + cells[:, 1], return_index=True)
        first.sort()
        if len(first) > count_max:
            first = first[np.linspace(0, len(first) - 1, count_max).astype(np.int64)]
        return self.take(first)


def surfels_of_scan(scan: LaserScan, bearing_std_rad: float, reach_max_m: float) -> Surfels:
    """Surfels in the LRF frame, by bearing; readings beyond `reach_max_m` are left out."""
    used = np.flatnonzero(np.nan_to_num(scan.ranges_m, nan=np.inf) <= reach_max_m)
    used = used[np.argsort(scan.bearings_rad[used], kind="stable")]
    ranges, bearings = scan.ranges_m[used], scan.bearings_rad[used]
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    points = ranges[:, None] * rays
    count = len(points)
    offsets = np.array([k for k in range(-NEIGHBOURS_PER_SIDE, NEIGHBOURS_PER_SIDE + 1) if k])
    # near readings lie so close that noise would hide the line: their voters are further apart
    spacing_m = ranges * (np.median(np.diff(bearings)) if count > 1 else 1.0)
    stride = np.clip(np.round(VOTER_SPACING_M / np.maximum(spacing_m, 1e-6)), 1, STRIDE_MAX)
    index = np.arange(count) + offsets[:, None] * stride.astype(np.int64)  # (2k, N)
    inside = (index >= 0) & (index < count)
    index = np.clip(index, 0, max(count - 1, 0))
    x, y = points.T.copy()
    step_x, step_y = x.take(index) - x, y.take(index) - y
    reach = REACH_M + REACH_PER_M * ranges
    votes = (inside & (step_x**2 + step_y**2 < reach**2)).astype(np.float64)

    votes_count = votes.sum(axis=0)
    weight = votes_count + 1.0
    along_rad, along_var, across_var = _axes(step_x, step_y, votes, weight)
    normals = np.stack([-np.sin(along_rad), np.cos(along_rad)], axis=-1)
    normals *= np.where((normals * points).sum(axis=-1) > 0.0, -1.0, 1.0)[:, None]
    # Noise is no bend: what it explains across a line does not speak against the line.
    range_var = scan.range_std_m[used] ** 2
    noise_var = np.minimum(NOISE_FACTOR * range_var, NOISE_RATIO**2 * along_var)
    is_flat = (votes_count >= VOTES_MIN) & (across_var < FLAT_RATIO**2 * along_var + noise_var)

    beside = np.concatenate([ranges[:1], ranges, ranges[-1:]])
    is_behind = np.minimum(beside[:-2], beside[2:]) < ranges - reach
    normals = np.where(is_flat[:, None], normals, -rays)
    cos_incidence = (normals * rays).sum(axis=-1)
    bearing_var = (ranges * bearing_std_rad) ** 2
    votes_var = np.maximum(across_var, range_var) / (along_var + 1e-12) / weight
    tilt_std = np.sqrt(votes_var + TILT_STD_MIN_RAD**2)
    flat_var = cos_incidence**2 * range_var + (1.0 - cos_incidence**2) * bearing_var
    round_var = range_var + bearing_var + ROUND_STD_M**2
    return Surfels(
        points_m=points,
        normals=normals,
        is_flat=is_flat,
        std_m=np.sqrt(np.where(is_flat, flat_var, round_var)),
        tilt_std_rad=np.where(is_flat, tilt_std, 0.0),
        is_lone=(votes_count < VOTES_MIN) | (is_behind & ~is_flat),
        sources=np.full(count, -1),
    )


def _axes(
    step_x: FloatArray, step_y: FloatArray, votes: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Direction (N,) of the line through each point and its voters, spread along and across.

    Steps (2k, N) lead from a point to the voters, `votes` (2k, N) are 0 or 1; `weight` (N,) is
    their number and the point itself.
    """
    voted_x, voted_y = votes * step_x, votes * step_y
    mean_x, mean_y = voted_x.sum(axis=0) / weight, voted_y.sum(axis=0) / weight
    xx = (voted_x * step_x).sum(axis=0) / weight - mean_x * mean_x
    xy = (voted_x * step_y).sum(axis=0) / weight - mean_x * mean_y
    yy = (voted_y * step_y).sum(axis=0) / weight - mean_y * mean_y
    half_gap = np.sqrt((0.5 * (xx - yy)) ** 2 + xy**2)
    middle = 0.5 * (xx + yy)
    along_rad = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return along_rad, middle + half_gap, np.maximum(middle - half_gap, 0.0)
