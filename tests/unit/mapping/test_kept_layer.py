# SPDX-License-Identifier: MIT
"""Layers kept while the map grows are what they would be if worked out afresh."""

import copy

import numpy as np
import pytest

from ins_robot.config import LrfConfig, MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.kept_layer import Changes, KeptLayer
from ins_robot.mapping.occupancy_grid import CLEARANCE_UP_TO_M, OccupancyGrid
from ins_robot.messages import LaserScan


def scan_of(rng):
    bearings = np.radians(np.arange(0.0, 360.0, 1.0) - 180.0)
    ranges = 2.0 + 1.5 * np.sin(3.0 * bearings) + rng.normal(0.0, 0.05, 360)
    ranges[rng.random(360) < 0.1] = np.nan
    return LaserScan(
        stamp_s=0.0, bearings_rad=bearings, ranges_m=ranges,
        range_std_m=np.full(360, 0.01), beam_offsets_s=np.zeros(360), range_max_m=6.0,
    )  # fmt: skip


def afresh(grid):
    fresh = copy.deepcopy(grid)
    fresh._clearance, fresh._doubt = (KeptLayer(CLEARANCE_UP_TO_M) for _ in range(2))
    return fresh


@pytest.mark.parametrize("seed", range(3))
def test_clearance_and_doubt_are_those_of_the_whole_map(seed):
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(0.05, MapConfig())
    for step in range(8):
        pose = Pose2(*rng.uniform(-3.0, 3.0, 2) * (1 + step), rng.uniform(-3.0, 3.0))
        grid.integrate(scan_of(rng), pose, LrfConfig().range_trusted_m)
        if step % 3 == 1:
            continue  # two scans between two looks
        fresh = afresh(grid)
        np.testing.assert_allclose(grid.clearance_m(), fresh.clearance_m(), atol=1e-9)
        np.testing.assert_allclose(grid.doubt_m(), fresh.doubt_m(), atol=1e-9)


def test_only_what_changed_is_worked_out_again():
    grid = OccupancyGrid(0.05, MapConfig())
    for x_m in (-12.0, 12.0, 0.0):
        grid.integrate(scan_of(np.random.default_rng(0)), Pose2(x_m, 0.0, 0.0), 3.0)
    grid.clearance_m()
    grid.integrate(scan_of(np.random.default_rng(1)), Pose2(12.0, 0.0, 0.0), 3.0)
    asked = []

    def work_out(rows, cols):
        asked.append((rows, cols))
        return grid._clearance_within(rows, cols)

    grid._clearance.on(grid, grid._changes, work_out)
    (_, cols), *others = asked
    assert not others
    assert cols.start > grid.shape[1] // 2
    assert grid.clearance_m() is grid.clearance_m()


def test_without_a_change_there_is_no_box():
    changes = Changes()
    assert changes.since(0) is None
    changes.add((2, 3), (4, 5))
    changes.add((-1, 7), (1, 1))
    assert changes.since(0) == (-1, 3, 6, 8)
    assert changes.since(1) == (-1, 7, 0, 8)
    assert changes.since(2) is None
