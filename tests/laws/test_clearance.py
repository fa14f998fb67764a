# SPDX-License-Identifier: MIT
"""Distance to the nearest wall is that to the nearest of all wall squares, for any point."""

import numpy as np
import pytest

from ins_robot.simulation.clearance import Clearance

SCALE_M, ORIGIN_M = 0.05, (-1.0, 2.0)


def distance_to_squares(walls, cells):
    """(N,) from points (row, col) to the nearest of all wall cells."""
    squares = np.argwhere(walls) + 0.5
    off = np.maximum(np.abs(cells[:, None] - squares) - 0.5, 0.0)
    return np.hypot(off[..., 0], off[..., 1]).min(axis=1)


@pytest.fixture(params=[0.002, 0.02, 0.3])
def walls(request):
    walls = np.random.default_rng(3).random((50, 70)) < request.param
    walls[[0, -1]] = walls[:, [0, -1]] = True
    return walls


def test_field_is_exact_at_cell_centres(walls):
    centres = np.argwhere(~walls) + 0.5
    field = Clearance(walls, SCALE_M, ORIGIN_M).field_m
    np.testing.assert_allclose(field[~walls], distance_to_squares(walls, centres) * SCALE_M)
    assert not field[walls].any()


def test_any_point_is_exact_and_the_nearest_point_is_that_far(walls):
    clearance = Clearance(walls, SCALE_M, ORIGIN_M)
    cells = np.random.default_rng(4).random((800, 2)) * walls.shape
    wanted = distance_to_squares(walls, cells) * SCALE_M
    for (row, col), distance in zip(cells, wanted, strict=True):
        x, y = ORIGIN_M[0] + col * SCALE_M, ORIGIN_M[1] + row * SCALE_M
        wall = clearance.nearest_wall(x, y)
        assert wall.distance_m == pytest.approx(distance, abs=1e-12)
        assert np.hypot(wall.x_m - x, wall.y_m - y) == pytest.approx(distance, abs=1e-9)
        assert clearance.at_least_m(x, y) <= distance + 1e-12


def test_outside_is_wall(walls):
    clearance = Clearance(walls, SCALE_M, ORIGIN_M)
    assert clearance.nearest_wall(99.0, 0.0).distance_m == 0.0
    assert clearance.at_least_m(99.0, 0.0) == 0.0
