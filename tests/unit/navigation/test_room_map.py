# SPDX-License-Identifier: MIT
"""Distances from limits, kept while a map grows: the same as measured anew, for less."""

import numpy as np
import pytest

from ins_robot.config import MapConfig
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.navigation.limit_lines import LimitLine
from ins_robot.navigation.room_map import RoomMap

NEAR_M = 0.3
CELL_M = 0.1
LINES = [
    LimitLine.of_zone(
        Zone(name="a", kind=ZoneKind.NO_GO, points_m=((1, 1), (2.5, 1), (2.5, 2), (1, 2)))
    ),
    LimitLine.of_zone(Zone(name="b", kind=ZoneKind.WALL, points_m=((-4, 0), (-3, 2)))),
    LimitLine.of_zone(
        Zone(name="c", kind=ZoneKind.NO_GO, points_m=((40, 40), (41, 40), (40, 41)))
    ),
]
BOUNDARY = LimitLine.around(((-9, -9), (12, -8), (10, 9), (-8, 7)))


def grid_at(row, col, height, width):
    grid = OccupancyGrid(CELL_M, MapConfig())
    grid.log_odds = np.zeros((height, width), np.float32)
    grid._corner = (row, col)
    return grid


def expected(grid, lines):
    points = grid.metres(np.argwhere(np.ones(grid.shape, bool)))
    return np.minimum.reduce([line.room_m(points) for line in lines]).reshape(grid.shape)


GROWTH = [(-20, -30, 50, 60), (-20, -30, 50, 90), (-50, -60, 80, 150), (-50, -60, 110, 150)]
ELSEWHERE = [(5, 5, 20, 20), (300, 5, 20, 20), (-300, -300, 10, 10), (-20, -30, 60, 40)]


@pytest.mark.parametrize("windows", [GROWTH, GROWTH[::-1], ELSEWHERE])
@pytest.mark.parametrize("lines", [LINES, [BOUNDARY], [*LINES, BOUNDARY]])
def test_what_is_kept_is_what_would_be_measured(windows, lines):
    rooms = RoomMap(lines, NEAR_M)
    for window in windows:
        grid = grid_at(*window)
        room, exact = rooms.on(grid), expected(grid, lines)
        near = exact <= NEAR_M
        np.testing.assert_array_equal(room[near], exact[near])
        assert (room[~near] > NEAR_M).all()


def test_a_map_that_grows_is_measured_where_it_is_new_and_near_a_line():
    measured = []

    class Counted(LimitLine):
        def room_m(self, points_m):
            measured.append(len(points_m))
            return super().room_m(points_m)

    lines = [Counted(line.points_m, line.allowed) for line in (LINES[0], BOUNDARY)]
    rooms = RoomMap(lines, NEAR_M)
    rooms.on(grid_at(-100, -100, 200, 200))
    assert sum(measured) < 1.01 * 200 * 200
    measured.clear()
    rooms.on(grid_at(-100, -100, 200, 264))
    assert sum(measured) == 200 * 64
    measured.clear()
    rooms.on(grid_at(-100, -100, 200, 264))
    assert not measured
