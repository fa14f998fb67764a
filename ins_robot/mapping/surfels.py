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
        return Surfels(
            points_m=self.points_m[index],
            normals=self.normals[index],
            is_flat=self.is_flat[index],
            std_m=self.std_m[index],
            tilt_std_rad=self.tilt_std_rad[index],
            is_lone=self.is_lone[index],
            sources=self.sources[index],
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
    points = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
    count = len(points)
    offsets = np.array([k for k in range(-NEIGHBOURS_PER_SIDE, NEIGHBOURS_PER_SIDE + 1) if k])
    # near readings lie so close that noise would hide the line: their voters are further apart
    spacing_m = ranges * (np.median(np.diff(bearings)) if count > 1 else 1.0)
    stride = np.clip(np.round(VOTER_SPACING_M / np.maximum(spacing_m, 1e-6)), 1, STRIDE_MAX)
    index = np.arange(count)[:, None] + offsets * stride.astype(np.int64)[:, None]
    inside = (index >= 0) & (index < count)
    index = np.clip(index, 0, max(count - 1, 0))
    steps = points[index] - points[:, None, :]  # (N, 2k, 2)
    reach = REACH_M + REACH_PER_M * ranges
    votes = (inside & ((steps**2).sum(axis=-1) < (reach**2)[:, None])).astype(np.float64)

    weight = votes.sum(axis=1) + 1.0
    mean = (steps * votes[..., None]).sum(axis=1) / weight[:, None]
    second = np.einsum("nk,nki,nkj->nij", votes, steps, steps) / weight[:, None, None]
    second -= mean[:, :, None] * mean[:, None, :]
    xx, xy, yy = second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]
    half_gap = np.sqrt((0.5 * (xx - yy)) ** 2 + xy**2)
    along_var, across_var = (
        0.5 * (xx + yy) + half_gap,
        np.maximum(0.5 * (xx + yy) - half_gap, 0),
    )
    along_rad = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    normals = np.stack([-np.sin(along_rad), np.cos(along_rad)], axis=-1)
    normals *= np.where((normals * points).sum(axis=-1) > 0.0, -1.0, 1.0)[:, None]
    # Noise is no bend: what it explains across a line does not speak against the line.
    range_var = scan.range_std_m[used] ** 2
    noise_var = np.minimum(NOISE_FACTOR * range_var, NOISE_RATIO**2 * along_var)
    is_flat = (votes.sum(axis=1) >= VOTES_MIN) & (
        across_var < FLAT_RATIO**2 * along_var + noise_var
    )

    beside = np.concatenate([ranges[:1], ranges, ranges[-1:]])
    is_behind = np.minimum(beside[:-2], beside[2:]) < ranges - reach
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
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
        is_lone=(votes.sum(axis=1) < VOTES_MIN) | (is_behind & ~is_flat),
        sources=np.full(count, -1),
    )
