# SPDX-License-Identifier: MIT
"""One scan for people: revolutions in, what its polar plot shows out. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.mapping.polar_picture import PolarPicture
from ins_robot.messages import LaserScan
from ins_robot.sensing.range_error import range_std_m
from ins_robot.sensing.scan_filter import combine

WEAK_STDS = 1.01  # a weak return is marked by a larger deviation, and by nothing else


def polar_picture(revolutions: Sequence[LaserScan], config: LrfConfig) -> PolarPicture:
    """The scan that these revolutions make, beam by beam; weak where most readings are."""
    scan = combine(revolutions, config, float(np.median([turn.rpm for turn in revolutions])))
    ranges_m = np.stack([turn.ranges_m for turn in revolutions])
    stds_m = np.stack([turn.range_std_m for turn in revolutions])
    is_read = np.isfinite(ranges_m)
    plain_m = range_std_m(ranges_m, config.range_std_floor_m, config.range_std_per_m3)
    is_weak = is_read & (stds_m > WEAK_STDS * plain_m)
    is_mostly_weak = scan.is_valid & (2 * is_weak.sum(axis=0) > is_read.sum(axis=0))
    valid = int(scan.is_valid.sum())
    nearest = f"{np.nanmin(scan.ranges_m):.2f} m" if valid else "none"
    return PolarPicture(
        bearings_rad=scan.bearings_rad,
        ranges_m=scan.ranges_m,
        is_weak=is_mostly_weak,
        range_max_m=scan.range_max_m,
        caption=(
            f"{len(revolutions)} revolutions at {scan.rpm:.0f} rpm: {valid} of "
            f"{len(scan.ranges_m)} beams valid, {int(is_mostly_weak.sum())} weak; "
            f"nearest {nearest}"
        ),
    )
