# SPDX-License-Identifier: MIT
"""Distances to walls: right at known places, with their slopes, harmless far away."""

import numpy as np
import pytest

from ins_robot.mapping.distance_map import REACH_M, DistanceMap
from ins_robot.mapping.map_files import TernaryMap


def wall_along_y():
    """A wall of four cells, x from 1.0 to 1.2 m, in a map of 3 m by 2 m at (-1, 2)."""
    is_occupied = np.zeros((40, 60), dtype=bool)
    is_occupied[:, 40:44] = True
    return TernaryMap(
        resolution_m=0.05, origin_m=(-1.0, 2.0), is_occupied=is_occupied, is_free=~is_occupied
    )


def test_distances_before_within_and_behind_a_wall():
    field = DistanceMap(wall_along_y())
    points = np.array([[0.625, 3.025], [1.05, 3.025], [1.475, 3.025], [-0.9, 3.0]])
    distance, by_x, by_y = field.with_slope(points)
    assert distance[:3] == pytest.approx([0.4, 0.0, 0.3], abs=1e-6)
    assert distance[3] == REACH_M
    assert by_x[:3] == pytest.approx([-1.0, 0.0, 1.0], abs=1e-5)
    assert np.abs(by_y).max() < 1e-5
    np.testing.assert_array_equal([by_x[3], by_y[3]], 0.0)


def test_only_deep_inside_solid_walls_it_is_negative():
    is_occupied = np.zeros((40, 60), dtype=bool)
    is_occupied[:, 20:] = True
    solid = DistanceMap(
        TernaryMap(
            resolution_m=0.05,
            origin_m=(0.0, 0.0),
            is_occupied=is_occupied,
            is_free=~is_occupied,
        )
    )
    points = np.stack([0.925 + 0.05 * np.arange(7), np.full(7, 1.025)], axis=-1)
    distance, _, _ = solid.with_slope(points)
    np.testing.assert_allclose(distance, [0.1, 0.05, 0.0, 0.0, -0.05, -0.1, -0.15], atol=1e-6)


def test_slopes_are_the_derivatives():
    rng = np.random.default_rng(0)
    is_occupied = rng.random((30, 30)) < 0.03
    field = DistanceMap(
        TernaryMap(
            resolution_m=0.1, origin_m=(0.0, 0.0), is_occupied=is_occupied, is_free=~is_occupied
        )
    )
    points = rng.uniform(0.2, 2.8, (200, 2))
    _, by_x, by_y = field.with_slope(points)
    step = 1e-6
    right, up = (field.with_slope(points + d)[0] for d in ([step, 0.0], [0.0, step]))
    here = field.with_slope(points)[0]
    is_smooth = np.abs((points / 0.1 + 0.5) % 1.0 - 0.5).min(axis=1) > 1e-3
    np.testing.assert_allclose(((right - here) / step)[is_smooth], by_x[is_smooth], atol=1e-3)
    np.testing.assert_allclose(((up - here) / step)[is_smooth], by_y[is_smooth], atol=1e-3)


def test_points_far_outside_pull_nothing():
    distance, by_x, by_y = DistanceMap(wall_along_y()).with_slope(np.array([[99.0, -99.0]]))
    assert (distance[0], by_x[0], by_y[0]) == (REACH_M, 0.0, 0.0)


def test_cells_and_metres_are_inverse():
    field = DistanceMap(wall_along_y())
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (20, 2))
    np.testing.assert_allclose(field.metres(field.cells(points)), points)
