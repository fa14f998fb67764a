# SPDX-License-Identifier: MIT
"""Finished maps of simulated worlds and exact scans in them; for tests of finding the place."""

from __future__ import annotations

import math

import numpy as np

from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import TernaryMap
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.messages import LaserScan, MotionIncrement
from ins_robot.simulation.world import World

RESOLUTION_M = 0.05


def hall(width_m=7.0, height_m=4.0):
    """(H, W) walls of an empty room: turned by half a turn it is itself."""
    walls = np.ones((round(height_m / RESOLUTION_M), round(width_m / RESOLUTION_M)), dtype=bool)
    walls[4:-4, 4:-4] = False
    return World(walls, RESOLUTION_M)


def room():
    """A small room like no other from any side."""
    walls = hall(4.6, 3.8).is_occupied.copy()
    walls[4:20, 60:72] = True
    walls[50:60, 30:36] = True
    return World(walls, RESOLUTION_M)


def map_of(world, moved_m=(0.0, 0.0)):
    x, y = world.origin_m
    return TernaryMap(
        resolution_m=world.resolution_m,
        origin_m=(x + moved_m[0], y + moved_m[1]),
        is_occupied=world.is_occupied.copy(),
        is_free=~world.is_occupied,
    )


def scan_in(world, pose, rng, beams=180, missing=0.2, std_m=0.01, stamp_s=0.0):
    """What an LRF at `pose` sees all around, with Gaussian errors and lost beams."""
    bearings = -math.pi + np.arange(beams) * 2.0 * math.pi / beams
    start = world.cells(np.array([[pose.x_m, pose.y_m]]))
    scale = world.resolution_m
    ranges = (
        cast_rays(world.is_occupied, start, bearings + pose.heading_rad, 6.0 / scale) * scale
    )
    ranges = ranges + rng.normal(0.0, std_m, beams)
    ranges[~np.isfinite(ranges) | (rng.random(beams) < missing)] = np.nan
    return LaserScan(
        stamp_s=stamp_s,
        bearings_rad=bearings,
        ranges_m=ranges,
        range_std_m=np.where(np.isfinite(ranges), std_m, np.nan),
        beam_offsets_s=np.zeros(beams),
        range_max_m=6.0,
    )


def motion(delta, rng, std=(0.02, 0.02, 0.02)):
    """What the odometry says of a motion, noise and all."""
    return MotionIncrement(
        from_stamp_s=0.0,
        to_stamp_s=1.0,
        delta=delta @ Pose2.from_array(rng.normal(0.0, std)),
        covariance=np.diag(np.square(std)),
    )
