# SPDX-License-Identifier: MIT
"""A wall stays a wall when the sensor is as noisy as a real one, and clutter stays none."""

import numpy as np

from ins_robot.mapping.surfels import Surfels, surfels_of_scan
from ins_robot.messages import LaserScan

BEARINGS_RAD = np.radians(np.arange(-30.0, 31.0))


def surfels(ranges_m: np.ndarray, std_m: float) -> Surfels:
    scan = LaserScan(
        stamp_s=0.0,
        bearings_rad=BEARINGS_RAD,
        ranges_m=ranges_m,
        range_std_m=np.full(len(ranges_m), std_m),
        beam_offsets_s=np.zeros(len(ranges_m)),
        range_max_m=6.0,
    )
    return surfels_of_scan(scan, np.radians(0.5), 12.0)


def test_a_far_wall_is_flat_through_its_own_noise() -> None:
    rng = np.random.default_rng(0)
    wall_m = 3.8 / np.cos(BEARINGS_RAD)
    found = [surfels(wall_m + 0.025 * rng.standard_normal(61), 0.025) for _ in range(20)]
    assert np.mean([s.is_flat.mean() for s in found]) > 0.8
    said_exact = [surfels(wall_m + 0.025 * rng.standard_normal(61), 0.003) for _ in range(20)]
    assert np.mean([s.is_flat.mean() for s in said_exact]) < 0.6


def test_clutter_is_not_flat() -> None:
    rng = np.random.default_rng(0)
    found = [surfels(rng.uniform(3.5, 4.1, 61), 0.025) for _ in range(20)]
    assert np.mean([s.is_flat.mean() for s in found]) < 0.35
