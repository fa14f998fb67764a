# SPDX-License-Identifier: MIT
"""Casting many rays at once gives what walking one ray cell by cell gives."""

import math

import numpy as np
import pytest

from ins_robot.mapping.ray_cast import cast_rays, cells_on_rays


def walk(is_blocked, row, col, bearing_rad, limit):
    """Distance to the first blocked cell, and the cells on the way (Amanatides & Woo)."""
    height, width = is_blocked.shape
    r, c = math.floor(row), math.floor(col)
    cells = []
    dx, dy = math.cos(bearing_rad), math.sin(bearing_rad)
    pitch_x, pitch_y = 1 / max(abs(dx), 1e-9), 1 / max(abs(dy), 1e-9)
    next_x = (c + 1 - col if dx >= 0 else col - c) * pitch_x
    next_y = (r + 1 - row if dy >= 0 else row - r) * pitch_y
    t = 0.0
    while t <= limit:
        if not (0 <= r < height and 0 <= c < width) or is_blocked[r, c]:
            return t, cells
        cells.append((r, c))
        if next_x < next_y:
            t, c, next_x = next_x, c + (1 if dx >= 0 else -1), next_x + pitch_x
        else:
            t, r, next_y = next_y, r + (1 if dy >= 0 else -1), next_y + pitch_y
    return math.inf, cells


@pytest.fixture(params=[0.0, 0.01, 0.2], ids=lambda share: f"blocked={share}")
def rays(request):
    rng = np.random.default_rng(1)
    is_blocked = rng.random((40, 57)) < request.param
    starts = rng.random((700, 2)) * [44, 61] - 2  # some outside
    bearings = rng.uniform(-7, 7, 700)
    bearings[:80] = np.round(bearings[:80] / (math.pi / 2)) * (math.pi / 2)  # along the lines
    return is_blocked, starts, bearings


def test_distance_is_that_of_a_walk(rays):
    is_blocked, starts, bearings = rays
    wanted = [
        walk(is_blocked, *start, bearing, 30.0)[0]
        for start, bearing in zip(starts, bearings, strict=True)
    ]
    np.testing.assert_allclose(cast_rays(is_blocked, starts, bearings, 30.0), wanted)


def test_cells_are_those_of_a_walk_each_once(rays):
    is_blocked, starts, bearings = rays
    distance = np.minimum(cast_rays(is_blocked, starts, bearings, 30.0), 30.0)
    flat, ray = cells_on_rays(is_blocked.shape, starts, bearings, distance)
    for n, (start, bearing) in enumerate(zip(starts, bearings, strict=True)):
        wanted = walk(is_blocked, *start, bearing, 30.0)[1]
        found = [divmod(int(cell), is_blocked.shape[1]) for cell in flat[ray == n]]
        assert sorted(found) == sorted(wanted)
    assert not is_blocked.reshape(-1)[flat].any()


def test_a_ray_alone_is_the_ray_among_many(rays):
    is_blocked, starts, bearings = rays
    together = cast_rays(is_blocked, starts, bearings, 30.0)
    alone = [
        cast_rays(is_blocked, starts[n : n + 1], bearings[n : n + 1], 30.0)[0]
        for n in range(99)
    ]
    np.testing.assert_array_equal(together[:99], alone)


def test_one_start_serves_all_bearings():
    is_blocked = np.zeros((20, 20), dtype=bool)
    bearings = np.linspace(-3, 3, 1500)  # more than one block
    start = np.array([[10.3, 9.8]])
    np.testing.assert_array_equal(
        cast_rays(is_blocked, start, bearings, 99.0),
        cast_rays(is_blocked, np.repeat(start, 1500, axis=0), bearings, 99.0),
    )


def test_range_is_a_limit_and_the_grid_ends_blocked():
    is_blocked = np.zeros((10, 10), dtype=bool)
    start, bearing = np.array([[5.5, 5.5]]), np.array([0.0])
    assert cast_rays(is_blocked, start, bearing, 4.4)[0] == math.inf
    assert cast_rays(is_blocked, start, bearing, 4.5)[0] == pytest.approx(4.5)
    assert cast_rays(is_blocked, start + 9, bearing, 4.5)[0] == 0.0


def test_no_rays_no_answers():
    is_blocked = np.zeros((10, 10), dtype=bool)
    assert cast_rays(is_blocked, np.zeros((0, 2)), np.zeros(0), 5.0).shape == (0,)
    flat, ray = cells_on_rays((10, 10), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    assert flat.shape == ray.shape == (0,)
