# SPDX-License-Identifier: MIT
"""Layers kept while the map grows are what they would be if worked out afresh."""

import numpy as np
import pytest

from ins_robot.config import LrfConfig, MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.grid_window import GridWindow
from ins_robot.mapping.kept_layer import Changes
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.wall_distances import CLEARANCE_UP_TO_M
from ins_robot.messages import LaserScan


def scan_of(rng):
    bearings = np.radians(np.arange(0.0, 360.0, 1.0) - 180.0)
    ranges = 2.0 + 1.5 * np.sin(3.0 * bearings) + rng.normal(0.0, 0.05, 360)
    ranges[rng.random(360) < 0.1] = np.nan
    return LaserScan(
        stamp_s=0.0, bearings_rad=bearings, ranges_m=ranges,
        range_std_m=np.full(360, 0.01), beam_offsets_s=np.zeros(360), range_max_m=6.0,
    )  # fmt: skip


def growing(seed):
    """A grid after each of eight scans, taken ever farther apart."""
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(0.05, MapConfig())
    for step in range(8):
        pose = Pose2(*rng.uniform(-3.0, 3.0, 2) * (1 + step), rng.uniform(-3.0, 3.0))
        grid.integrate(scan_of(rng), pose, LrfConfig().range_trusted_m)
        yield grid, rng


def afresh(grid, work_out):
    whole = tuple(slice(0, n) for n in grid.shape)
    return np.minimum(work_out(grid, whole, whole), CLEARANCE_UP_TO_M)


@pytest.mark.parametrize("seed", range(3))
def test_clearance_and_doubt_are_those_of_the_whole_map(seed):
    for step, (grid, _) in enumerate(growing(seed)):
        if step % 3 == 1:
            continue  # two scans between two looks
        for kept, work_out in (
            (grid.clearance_m(), grid.distances._clearance_of),
            (grid.doubt_m(), grid.distances._doubt_of),
        ):
            np.testing.assert_allclose(kept, afresh(grid, work_out), atol=1e-9)


def test_only_what_changed_is_worked_out_again():
    grid = OccupancyGrid(0.05, MapConfig())
    for x_m in (-12.0, 12.0, 0.0):
        grid.integrate(scan_of(np.random.default_rng(0)), Pose2(x_m, 0.0, 0.0), 3.0)
    grid.clearance_m()
    grid.integrate(scan_of(np.random.default_rng(1)), Pose2(12.0, 0.0, 0.0), 3.0)
    asked = []

    def work_out(part, around):
        asked.append(around)
        return grid.distances._clearance_of(grid, part, around)

    grid.distances._clearance.on(
        grid, grid.distances.changes, work_out, tuple(slice(0, n) for n in grid.shape)
    )
    (_, cols), *others = asked
    assert not others
    assert cols.start > grid.shape[1] // 2
    assert grid.clearance_m() is grid.clearance_m()


def test_without_a_change_there_is_no_box_and_those_that_overlap_are_one():
    changes = Changes()
    assert changes.since(0) == []
    changes.add((2, 3), (4, 5))
    changes.add((-1, 7), (1, 1))
    assert changes.since(0) == [(2, 3, 6, 8), (-1, 7, 0, 8)]
    changes.add((-1, 7), (4, 1))
    assert changes.since(0) == [(-1, 3, 6, 8)]
    assert changes.since(1) == [(-1, 7, 3, 8)]
    assert changes.since(3) == []


def test_a_window_shows_what_the_grid_shows():
    rng = np.random.default_rng(0)
    grid = OccupancyGrid(0.05, MapConfig())
    for x_m in (-4.0, 5.0):
        grid.integrate(scan_of(rng), Pose2(x_m, 0.0, 0.0), 3.0)
    part = slice(30, 140), slice(20, 260)
    window = GridWindow(grid, part)
    for name in ("clearance_m", "doubt_m"):
        np.testing.assert_array_equal(getattr(window, name)(), getattr(grid, name)()[part])
    point = np.array([1.0, 0.5])
    assert window.log_odds_at(point) == grid.log_odds_at(point)
    centre = grid.metres(grid.cells(point))
    np.testing.assert_allclose(window.metres(window.cells(point)), centre)
    with pytest.raises(ValueError, match="read-only"):
        window.log_odds[0, 0] = 1.0


def test_what_is_known_is_counted_as_it_is_drawn():
    grid = OccupancyGrid(0.05, MapConfig())
    for step in range(5):
        scan = scan_of(np.random.default_rng(step))
        grid.integrate(scan, Pose2(2.0 * step, 0.0, 0.0), 3.0)
    other = OccupancyGrid(0.05, MapConfig())
    other.make_room(grid.corner, tuple(np.add(grid.corner, grid.shape)))
    other.take_over(grid)
    count = np.count_nonzero(~grid.is_unknown)
    assert grid.known_m2 == other.known_m2 == pytest.approx(count * 0.05**2)


def test_clearance_follows_when_a_lone_reading_turns_out_a_ghost():
    """Others look past it from afar, so that no reading near it changes."""
    bearings = np.radians(np.arange(-40.0, 41.0))
    grid = OccupancyGrid(0.05, MapConfig())
    ranges = 1.9 / np.cos(bearings)
    ranges[40] -= 0.065
    told = []
    for back_m in [0.0, *[1.4] * 9]:
        seen = ranges if back_m == 0.0 else (1.9 + back_m) / np.cos(bearings)
        scan = LaserScan(
            stamp_s=0.0, bearings_rad=bearings, ranges_m=seen, range_std_m=np.full(81, 0.01),
            beam_offsets_s=np.zeros(81), range_max_m=6.0,
        )  # fmt: skip
        grid.integrate(scan, Pose2(-back_m, 0.0, 0.0), 5.0)
        fresh = afresh(grid, grid.distances._clearance_of)
        np.testing.assert_allclose(grid.clearance_m(), fresh, atol=1e-9)
        told.append(float(grid.walls().query((1.835, 0.0))[0]))
    assert told[0] < 0.01
    assert told[-1] > 0.05


@pytest.mark.parametrize("seed", range(3))
def test_parts_asked_for_in_any_order_are_parts_of_the_whole(seed):
    for grid, rng in growing(seed):
        low = rng.integers(0, np.array(grid.shape) - 32)
        high = rng.integers(low + 1, grid.shape)
        part = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        window = GridWindow(grid, part)
        for kept, work_out in (
            (window.clearance_m(), grid.distances._clearance_of),
            (window.doubt_m(), grid.distances._doubt_of),
        ):
            np.testing.assert_allclose(kept, afresh(grid, work_out)[part], atol=1e-9)
