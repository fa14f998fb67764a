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


def test_what_comes_out_from_behind_something_is_no_edge_but_what_stands_before_is() -> None:
    """A crumpled thing of three readings, far behind a hole in a wall, and far before one."""
    crumpled = np.array([0.0, 0.1, 0.0])
    for around_m, there_m, is_lone in (
        (1.0, 3.0, [True, False, True]),
        (5.0, 3.0, [False] * 3),
    ):
        ranges_m = np.full(61, around_m)
        ranges_m[29:32] = there_m + crumpled
        found = surfels(ranges_m, 0.003)
        assert not found.is_flat[29:32].any()
        assert found.is_lone[29:32].tolist() == is_lone
