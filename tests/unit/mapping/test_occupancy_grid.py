# SPDX-License-Identifier: MIT
"""The grid says free, occupied and unknown where a scan does, and nothing where it does not."""

import math

import numpy as np
import pytest

from ins_robot.config import MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan

RESOLUTION_M = 0.05
TRUSTED_M = 3.0


def scan_of(ranges_m, std_m=0.005, bearings=None, **more):
    ranges = np.asarray(ranges_m, float)
    count = len(ranges)
    if bearings is None:
        bearings = -math.pi + np.arange(count) * 2 * math.pi / count
    return LaserScan(
        stamp_s=0.0,
        bearings_rad=np.asarray(bearings, float),
        ranges_m=ranges,
        range_std_m=np.where(np.isfinite(ranges), std_m, np.nan),
        beam_offsets_s=np.zeros(count),
        **({"range_max_m": 6.0} | more),
    )


def grid_of(*scans_at):
    grid = OccupancyGrid(RESOLUTION_M, MapConfig())
    for scan, pose in scans_at:
        grid.integrate(scan, pose, TRUSTED_M)
    return grid


def test_round_room_is_free_inside_occupied_on_the_rim_unknown_outside():
    grid = grid_of((scan_of(np.full(360, 2.0)), Pose2(0.3, -0.2, 0.5)))
    cells = np.argwhere(np.ones(grid.shape, bool))
    radius = np.hypot(*(grid.metres(cells) - (0.3, -0.2)).T).reshape(grid.shape)
    assert grid.is_free[radius < 1.85].all()
    assert not grid.is_free[radius > 2.05].any()
    assert grid.is_unknown[radius > 2.1].all()
    assert not grid.is_occupied[(radius < 1.9) | (radius > 2.1)].any()
    bearings = np.linspace(0, 2 * math.pi, 720)
    rim = np.array([0.3, -0.2]) + 2.0 * np.stack([np.cos(bearings), np.sin(bearings)], -1)
    assert (grid.log_odds_at(rim) > 0.2).mean() > 0.9


def test_one_scan_counts_once_per_cell_and_hits_beat_misses():
    config = MapConfig()
    grid = grid_of((scan_of(np.full(3600, 0.5)), Pose2()))
    assert grid.log_odds.max() <= config.hit_log_odds
    assert grid.log_odds.min() >= -config.miss_log_odds - 1e-6
    # beams that pass through the cell in which another one ends do not clear it
    ranges, bearings = [1.0, 3.0, 3.0], [0.0, 0.002, -0.002]
    grid = grid_of((scan_of(ranges, bearings=bearings), Pose2(0.025, 0.025, 0.0)))
    assert grid.log_odds_at(np.array([[1.025, 0.025]]))[0] > 0.5


def test_noisy_returns_weigh_less():
    near = grid_of((scan_of(np.full(360, 2.0), std_m=0.003), Pose2()))
    weak = grid_of((scan_of(np.full(360, 2.0), std_m=0.05), Pose2()))
    assert weak.log_odds.max() < 0.5 * near.log_odds.max()


def test_log_odds_are_clamped_so_that_doors_reopen():
    closed = scan_of(np.full(360, 1.0))
    opened = scan_of(np.full(360, 3.0))
    grid = grid_of(*[(closed, Pose2())] * 200)
    assert grid.log_odds.max() == pytest.approx(MapConfig().log_odds_max)
    for _ in range(25):
        grid.integrate(opened, Pose2(), TRUSTED_M)
    assert grid.log_odds_at(np.array([[1.0, 0.01]]))[0] < 0.0


@pytest.mark.parametrize(("means_free", "expected_m"), [(True, 6.0), (False, 1.0)])
def test_silence_frees_only_what_the_sensor_means(means_free, expected_m):
    ranges = np.full(360, 1.5)
    ranges[200:240] = 1.0
    ranges[180:200] = np.nan  # readings beside the run: 1.5 m and 1.0 m
    grid = grid_of((scan_of(ranges, is_free_when_silent=means_free), Pose2()))
    bearing = math.radians(10.0)
    along = np.arange(0.0, 5.8, 0.025)
    values = grid.log_odds_at(along[:, None] * [math.cos(bearing), math.sin(bearing)])
    assert (values[along < expected_m - 0.15] < 0.0).mean() > 0.97  # corners are skipped
    assert (values[along > expected_m + 0.15] == 0.0).all()


def test_silence_frees_one_metre_at_most_and_nothing_at_an_open_end():
    ranges = np.full(181, 5.0)
    ranges[80:100] = np.nan
    ranges[:30] = np.nan
    bearings = np.radians(np.arange(181) - 90.0)
    grid = grid_of((scan_of(ranges, bearings=bearings), Pose2()))
    ahead = grid.log_odds_at(np.array([[0.9, 0.0], [1.1, 0.0]]))
    assert ahead[0] < 0.0
    assert ahead[1] == 0.0
    assert grid.log_odds_at(np.array([[0.3, -1.0]]))[0] == 0.0


def test_run_across_the_seam_of_a_full_turn_has_two_neighbours():
    ranges = np.full(360, 2.0)
    ranges[:7] = ranges[-7:] = np.nan  # too wide to be a dark leg
    grid = grid_of((scan_of(ranges), Pose2()))
    assert grid.log_odds_at(np.array([[-0.8, 0.0]]))[0] < 0.0


def test_distance_is_euclidean_cached_and_follows_changes():
    grid = OccupancyGrid(RESOLUTION_M, MapConfig())
    assert np.isinf(grid.distance_m()).all()
    grid.integrate(scan_of([1.0], bearings=[0.0]), Pose2(0.025, 0.025, 0.0), TRUSTED_M)
    distance = grid.distance_m()
    assert distance is grid.distance_m()
    start, wall = grid.cells(np.array([[0.025, 0.025], [1.03, 0.025]]))
    assert distance[tuple(wall)] == 0.0
    # around the cell that was hit seven are unknown, and count as its body; one was crossed
    assert grid.is_solid.sum() == 8
    assert distance[tuple(start)] == pytest.approx(np.hypot(0.95, 0.05), abs=1e-9)
    grid.integrate(scan_of([1.0], bearings=[2.0]), Pose2(), TRUSTED_M)
    assert distance is not grid.distance_m()


def test_cells_outside_are_unknown_and_conversion_round_trips():
    grid = grid_of((scan_of(np.full(360, 4.0)), Pose2(30.0, -12.0, 0.0)))
    points = np.array([[30.0, -12.0], [-7.0, 3.0], [1000.0, 0.0]])
    cells = grid.cells(points)
    assert np.abs(grid.metres(cells) - points).max() <= RESOLUTION_M / 2 + 1e-9
    assert (grid.cells(grid.metres(cells)) == cells).all()
    assert grid.log_odds_at(points)[2] == 0.0
    assert not grid.contains(cells)[2]


def test_empty_scan_changes_nothing():
    grid = grid_of((scan_of(np.full(90, np.nan)), Pose2()))
    assert grid.is_unknown.all()


def test_a_long_silent_run_is_quiet_ground_but_not_free():
    """A doorway to a large room: readings at the jambs 0.5 m away, nothing between them."""
    bearings = np.radians(np.arange(-90.0, 91.0))
    ranges = np.where(np.abs(bearings) < 0.4, np.nan, 0.5 / np.cos(0.4))
    grid = grid_of((scan_of(ranges, bearings=bearings), Pose2()))
    beyond = tuple(grid.cells(np.array([0.8, 0.0])))
    assert grid.is_unknown[beyond]
    assert grid.is_quiet[beyond]
    far = tuple(grid.cells(np.array([MapConfig().silent_free_m + 0.1, 0.0])))
    assert not grid.is_quiet[far]


def test_a_few_lost_readings_are_not_quiet_ground():
    bearings = np.radians(np.arange(-90.0, 91.0))
    ranges = np.where(np.abs(bearings) < np.radians(3.4), np.nan, 0.5)
    assert not grid_of((scan_of(ranges, bearings=bearings), Pose2())).is_quiet.any()


def test_where_silence_means_free_nothing_is_quiet():
    scan = scan_of(np.full(360, np.nan), is_free_when_silent=True)
    assert not grid_of((scan, Pose2())).is_quiet.any()


@pytest.mark.parametrize("away_m", [0.3, 0.5, 0.75, 0.95])
def test_a_dark_leg_does_not_become_free_ground(away_m):
    """5 cm thick, it swallows every beam that meets it; the walls around answer."""
    bearings = np.radians(np.arange(360.0))
    is_swallowed = np.abs(np.sin(bearings / 2.0)) < np.sin(np.arctan(0.025 / away_m) / 2.0)
    scan = scan_of(np.where(is_swallowed, np.nan, 2.0), bearings=bearings)
    grid = grid_of(*[(scan, Pose2(0.003 * k, 0.025, 0.0)) for k in range(5)])
    assert not grid.is_free[tuple(grid.cells(np.array([away_m + 0.03, 0.025])))]
    assert grid.is_free[tuple(grid.cells(np.array([0.15, 0.025])))]


def test_a_single_lost_reading_still_frees_its_way():
    bearings = np.radians(np.arange(360.0))
    ranges = np.full(360, 2.0)
    ranges[[0, 120]] = np.nan
    grid = grid_of((scan_of(ranges, bearings=bearings), Pose2()))
    assert grid.is_free[tuple(grid.cells(np.array([0.8, 0.0])))]
