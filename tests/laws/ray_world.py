# SPDX-License-Identifier: MIT
"""Walls as segments, exact scans among them, a robot whose odometry errs; for SLAM tests."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.messages import LaserScan, MotionIncrement


def box(x0, y0, x1, y1):
    """(4, 4) walls x0, y0, x1, y1 of a rectangle."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


ROOM = np.array(
    [*box(-3.0, -2.0, 4.0, 3.0), *box(1.5, 1.0, 2.2, 1.6), *box(-2.0, -1.2, -1.5, -0.8)]
)
CORRIDOR = np.array([(-50.0, -1.0, 50.0, -1.0), (-50.0, 1.0, 50.0, 1.0)])
RING = np.array(
    [
        *box(-1.0, -1.0, 11.0, 11.0),
        *box(1.0, 1.0, 9.0, 9.0),
        *box(4.0, -1.0, 4.4, -0.7),
        *box(9.0, 5.0, 9.3, 5.6),
        *box(10.6, 2.0, 11.0, 2.5),
        *box(3.0, 10.6, 3.8, 11.0),
        *box(-1.0, 6.5, -0.6, 7.0),
    ]
)


def full_turn(beams=360):
    return -math.pi + np.arange(beams) * 2 * math.pi / beams


def scan_at(walls, pose, rng, bearings, stamp_s=0.0, missing=0.0, range_max_m=6.0, std_m=0.01):
    """What an LRF at `pose` (3,) sees, with Gaussian errors and lost beams."""
    x, y, heading = pose
    dx, dy = np.cos(bearings + heading)[:, None], np.sin(bearings + heading)[:, None]
    ax, ay, bx, by = walls.T
    ex, ey = bx - ax, by - ay
    across = dx * ey - dy * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        along = ((ax - x) * ey - (ay - y) * ex) / across
        share = ((ax - x) * dy - (ay - y) * dx) / across
    hit = (share >= 0.0) & (share <= 1.0) & (along > 0.0)
    ranges = np.where(hit, along, np.inf).min(axis=1)
    ranges = ranges + rng.normal(0.0, std_m, len(ranges))
    ranges[(ranges > range_max_m) | (rng.random(len(ranges)) < missing)] = np.nan
    return LaserScan(
        stamp_s=stamp_s,
        bearings_rad=np.array(bearings),
        ranges_m=ranges,
        range_std_m=np.where(np.isfinite(ranges), std_m, np.nan),
        beam_offsets_s=np.zeros(len(ranges)),
        range_max_m=range_max_m,
    )


def motion_between(
    before, after, rng=None, scale=1.0, turn_bias_rad=0.0, std=(0.03, 0.03, 0.02)
):
    """Odometry's opinion of a motion, biased and noisy, with the covariance it claims."""
    delta = between(np.asarray(before, float), np.asarray(after, float))
    error = np.zeros(3) if rng is None else rng.normal(0.0, std)
    delta = delta * (scale, scale, 1.0) + error + (0.0, 0.0, turn_bias_rad)
    return MotionIncrement(
        from_stamp_s=0.0,
        to_stamp_s=1.0,
        delta=Pose2.from_array(delta),
        covariance=np.diag(np.square(std)),
    )


def drive(slam: Slam, walls, path, seed, keep=Keep.ALWAYS, motion=None, **scan):
    """Scan at each pose of `path` (N, 3), from the origin on; returns estimates (N, 3)."""
    rng = np.random.default_rng(seed)
    bearings = scan.pop("bearings", full_turn())
    estimates = []
    for i, pose in enumerate(path):
        if i:
            step = motion_between(path[i - 1], pose, rng, **(motion or {}))
        else:
            step = motion_between(pose, pose)
        seen = scan_at(walls, pose, rng, bearings, stamp_s=float(i), **scan)
        estimates.append(slam.step(seen, step, keep).pose.as_array())
    return np.array(estimates)


def along_way_points(points, step_m):
    """(N, 3) poses every `step_m` along a polyline, facing forward."""
    poses = []
    points = np.asarray(points, float)
    for a, b in pairwise(points):
        count = max(1, round(float(np.hypot(*(b - a))) / step_m))
        heading = math.atan2(b[1] - a[1], b[0] - a[0])
        poses += [(*(a + (b - a) * k / count), heading) for k in range(count)]
    return np.array([*poses, (*points[-1], poses[-1][2])])


def position_errors_m(estimates, path):
    return np.hypot(*(estimates - path)[:, :2].T)
