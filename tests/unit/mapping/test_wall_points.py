# SPDX-License-Identifier: MIT
"""Readings from near tell where a wall is, to millimetres, wherever the grid's lines run."""

import numpy as np
import pytest

from ins_robot.config import MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.wall_distances import CLEARANCE_UP_TO_M
from ins_robot.mapping.wall_points import wall_points
from tests.unit.mapping.test_occupancy_grid import scan_of

BEARINGS = np.linspace(-1.2, 1.2, 240)
ONCE = np.ones(3, np.int64)


def _grid(*seen: tuple[Pose2, np.ndarray, np.ndarray]) -> OccupancyGrid:
    grid = OccupancyGrid(0.05, MapConfig())
    for pose, ranges, bearings in seen:
        grid.integrate(scan_of(ranges, bearings=bearings), pose, 3.0)
    return grid


@pytest.mark.parametrize("wall_m", [1.0, 1.01, 1.025, 1.04])
def test_clearance_is_to_the_wall_itself_not_to_its_cells(wall_m: float) -> None:
    grid = _grid((Pose2(), wall_m / np.cos(BEARINGS), BEARINGS))
    rows, cols = np.indices(grid.shape)
    centres = grid.metres(np.stack([rows, cols], axis=-1))
    near = (np.abs(wall_m - 0.2 - centres[..., 0]) < 0.1) & (np.abs(centres[..., 1]) < 0.5)
    off = grid.clearance_m()[near] - (wall_m - centres[near][:, 0])
    assert np.abs(off).max() < 0.003
    coarse = grid.distance_m()[near] - 0.5 * grid.resolution_m
    assert np.abs(coarse - (wall_m - centres[near][:, 0])).max() > 0.009


def test_a_leg_outvoted_in_half_of_its_cells_is_still_there() -> None:
    """Many beams pass beside it, through a cell that its face reaches into by a centimetre."""
    leg = np.array([0.29, 0.30, 0.31])
    passing = (Pose2(0.01, -0.03, 0.0), np.full(40, 2.9), np.linspace(-0.02, 0.1, 40))
    scans = [(Pose2(), np.full(3, 1.0), leg)] + 12 * [passing]
    grid = _grid(*scans)
    tip = np.array([np.cos(0.29), np.sin(0.29)])
    assert grid.walls().query(tip)[0] < 0.005


def test_the_reading_from_nearer_counts() -> None:
    far, near = np.array([[1.0, 0.02], [1.0, 0.2]]), np.array([[1.01, 0.02]])
    solid = np.ones((40, 40), bool)
    points = np.concatenate([far, near])
    cells = np.floor(points[:, ::-1] / 0.05).astype(np.int64)
    kept, told = wall_points(points, np.array([1.9, 1.9, 0.5]), ONCE, cells, solid, ~solid)
    assert sorted(map(tuple, kept.tolist())) == [(1.0, 0.2), (1.01, 0.02)]
    assert told[0, 20]
    assert not told[30, 30]


def test_a_corner_keeps_its_tip_whatever_ring_it_lies_in() -> None:
    """A post's face seen from 0.49 to 0.51 m: the far end is no less true than the near one."""
    bearings = np.radians(np.arange(-15.0, 16.0))
    ranges = 0.49 / np.cos(bearings)
    grid = _grid((Pose2(), ranges, bearings))
    tip = 0.49 * np.array([1.0, np.tan(bearings[-1])])
    assert grid.walls().query(tip)[0] < 1e-6


def test_a_reading_where_nothing_solid_was_found_is_a_ghost() -> None:
    solid = np.zeros((40, 40), bool)
    solid[0, 0] = True
    points = np.array([[0.045, 0.045], [0.055, 0.055], [1.0, 1.0]])
    cells = np.floor(points[:, ::-1] / 0.05).astype(np.int64)
    kept, _ = wall_points(points, np.full(3, 0.5), ONCE, cells, solid, ~solid)
    np.testing.assert_array_equal(kept, points[:2])


@pytest.mark.parametrize("near_m", [0.31, 0.51, 0.96, 1.9])
def test_a_reading_alone_before_a_wall_is_a_ghost(near_m: float) -> None:
    """Half of the beam on a post, half beyond: once, six centimetres before the wall."""
    bearings = np.radians(np.arange(-20.0, 21.0))
    wall = (near_m + 0.06) / np.cos(bearings)
    often = [(Pose2(), wall, bearings)] * 4
    both = (([20], 0.06), ([20, 21], 0.0))  # two side by side have hit something
    for beams, away_m in both if near_m < 1.0 else both[:1]:
        once = wall.copy()
        once[beams] -= 0.06
        grid = _grid((Pose2(), once, bearings), *often)
        assert grid.walls().query((near_m, 0.0))[0] == pytest.approx(away_m, abs=0.01)


def test_a_map_of_nothing_has_no_walls() -> None:
    grid = OccupancyGrid(0.05, MapConfig())
    assert (grid.clearance_m() == CLEARANCE_UP_TO_M).all()
    assert np.isinf(grid.walls().query((0.0, 0.0))[0])
