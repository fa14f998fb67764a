# SPDX-License-Identifier: MIT
"""A scan taken while driving -> the scan a standing robot would have taken at its stamp.

One revolution lasts 300 ms at 200 rpm: 6 cm at 0.2 m/s, 17 degrees at 1 rad/s. The poses come
from odometry, interpolated at each beam's time; SLAM is next. Pure.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ins_robot.geometry import pose2
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan
from ins_robot.sensing.scan_filter import take_beams


def deskew(
    scan: LaserScan,
    odom_from_base_at_beams: FloatArray,
    odom_from_base_at_stamp: FloatArray,
    base_from_lrf: Pose2,
) -> LaserScan:
    """Ranges and bearings as seen from the LRF's pose at the scan's stamp.

    Parameters
    ----------
    scan : LaserScan
        B beams, each at `stamp_s + beam_offsets_s`.
    odom_from_base_at_beams : (B, 3) float64
        Pose of the base at each beam's time: x_m, y_m, heading_rad.
    odom_from_base_at_stamp : (3,) float64
        Pose of the base at `stamp_s`.
    base_from_lrf : Pose2
        Where the LRF sits.

    Returns
    -------
    LaserScan
        The same beams in order of their new bearing in [-pi, pi), offsets zero. A beam
        without a reading is turned with the others; where it looked from is lost.
    """
    odom_from_lrf_at_beams = pose2.compose(odom_from_base_at_beams, base_from_lrf.as_array())
    odom_from_lrf = pose2.compose(odom_from_base_at_stamp, base_from_lrf.as_array())
    stamp_from_beams = pose2.between(odom_from_lrf, odom_from_lrf_at_beams)
    turned_rad = scan.bearings_rad + stamp_from_beams[:, 2]
    x_m = stamp_from_beams[:, 0] + scan.ranges_m * np.cos(turned_rad)
    y_m = stamp_from_beams[:, 1] + scan.ranges_m * np.sin(turned_rad)
    bearings_rad = wrap_rad(np.where(scan.is_valid, np.arctan2(y_m, x_m), turned_rad))
    moved = dataclasses.replace(
        scan,
        bearings_rad=bearings_rad,
        ranges_m=np.hypot(x_m, y_m),
        beam_offsets_s=np.zeros(len(bearings_rad)),
    )
    return take_beams(moved, np.argsort(bearings_rad, kind="stable"))
