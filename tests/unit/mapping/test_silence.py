# SPDX-License-Identifier: MIT
"""Silence: free in a hall, but not where walls beside it would go on, or are known to be."""

import numpy as np
import pytest

from ins_robot.config import MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.silence import SilenceRules, read_silence
from ins_robot.messages import LaserScan

BEARINGS = np.radians(np.arange(-180.0, 180.0))
NEAR_M, TRUSTED_M = 1.0, 3.0
WIDE = SilenceRules(near_m=0.0, trusted_m=TRUSTED_M, wide_rad=np.radians(40.0))
RULES = SilenceRules(near_m=NEAR_M, trusted_m=TRUSTED_M, wide_rad=np.radians(40.0))


def scan_of(ranges) -> LaserScan:
    ranges = np.array(ranges, float)
    return LaserScan(
        stamp_s=0.0,
        bearings_rad=BEARINGS,
        ranges_m=ranges,
        range_std_m=np.where(np.isfinite(ranges), 0.01, np.nan),
        beam_offsets_s=np.zeros(len(ranges)),
        range_max_m=6.0,
    )


def wall_ahead(distance_m: float, up_to_m: float):
    """Readings of an endless wall across the x axis, silent beyond a length of beam."""
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(BEARINGS) > 0.0, distance_m / np.cos(BEARINGS), np.nan)
    return np.where(ranges <= up_to_m, ranges, np.nan)


def test_a_hall_with_one_wall_in_sight_is_free_all_around():
    free = read_silence(scan_of(wall_ahead(4.0, 6.0)), WIDE).free_m
    behind = np.abs(BEARINGS) > np.radians(90.0)
    assert (free[behind] == TRUSTED_M).all()
    assert (free[np.isfinite(wall_ahead(4.0, 6.0))] == 0.0).all()


@pytest.mark.parametrize("distance_m", [0.3, 0.6, 1.5])
def test_a_wall_that_falls_silent_at_a_slant_is_not_driven_into(distance_m):
    """It answers up to 2.5 times its distance; beyond, it goes on all the same."""
    scan = scan_of(wall_ahead(distance_m, 2.5 * distance_m))
    free = read_silence(scan, WIDE).free_m
    ahead = np.cos(BEARINGS) > 1e-6
    true_m = distance_m / np.cos(BEARINGS[ahead])
    assert (free[ahead] < true_m).all()
    assert free.max() == TRUSTED_M


def test_glass_between_two_posts_lies_on_their_line():
    """A pane 3 m wide, 1.5 m ahead, in the plane of the wall that holds it."""
    ranges = wall_ahead(1.5, 4.0)
    pane = np.abs(BEARINGS) < np.arctan(1.0)
    ranges[pane] = np.nan
    free = read_silence(scan_of(ranges), WIDE).free_m
    assert (free[pane] < 1.5 / np.cos(BEARINGS[pane])).all()


def test_narrow_silence_and_a_scan_without_readings_say_nothing():
    ranges = np.full(360, 2.0)
    ranges[100:130] = np.nan
    assert not read_silence(scan_of(ranges), WIDE).free_m.any()
    blind = read_silence(scan_of(np.full(360, np.nan)), RULES)
    assert not blind.free_m.any()
    assert not blind.quiet_m.any()
    stray = np.full(360, np.nan)
    stray[[10, 100, 200]] = 5.0
    told = read_silence(scan_of(stray), RULES)
    assert max(told.free_m.max(), told.quiet_m.max()) == 0.0


def test_silence_does_not_reach_past_a_wall_on_the_map():
    """A dark wall that was seen before from nearer."""
    grid = OccupancyGrid(0.05, MapConfig())
    for _ in range(3):
        grid.integrate(scan_of(wall_ahead(1.0, 1.3)), Pose2(1.0, 0.0, 0.0), TRUSTED_M)
    before = grid.is_occupied.copy()
    ranges = np.where(np.abs(BEARINGS) > np.radians(150.0), 2.0, np.nan)
    grid.integrate(scan_of(ranges), Pose2(), TRUSTED_M)
    assert before.any()
    known = grid.metres(np.argwhere(before))
    assert (grid.log_odds_at(known) > 0.0).all()
    assert not (grid.log_odds_at(np.array([[2.4, 0.0], [2.8, 0.1]])) < -0.05).any()


def test_a_post_that_was_seen_stays_however_often_beams_fall_silent_there():
    """Seen from before it; from beside it no beam comes back, scan after scan."""
    grid = OccupancyGrid(0.05, MapConfig())
    post = np.array([[0.72, 0.02], [0.72, -0.03]])
    seen = np.full(360, 2.0)
    seen[np.abs(BEARINGS) < np.radians(6.0)] = 0.5
    for _ in range(2):  # once may be a ghost
        grid.integrate(scan_of(seen), Pose2(0.22, 0.0, 0.0), TRUSTED_M)
    assert (grid.log_odds_at(post) > 0.0).all()
    silent = np.full(360, 2.0)
    silent[np.abs(BEARINGS) < np.radians(15.0)] = np.nan
    for _ in range(20):
        grid.integrate(scan_of(silent), Pose2(), TRUSTED_M)
    assert (grid.log_odds_at(post) > 0.0).all()
    assert (grid.log_odds_at(np.array([[0.4, 0.0], [0.9, 0.2]])) < -0.05).all()
    open_now = np.full(360, 2.0)
    for _ in range(20):
        grid.integrate(scan_of(open_now), Pose2(), TRUSTED_M)
    assert (grid.log_odds_at(post) < 0.0).all()  # what beams come back from beyond is gone


def test_wide_silence_reaches_beyond_what_the_map_held_before():
    """Wherever the lattice's blocks begin: the first scan and a later one free the same."""
    scan = scan_of(wall_ahead(4.0, 6.0))
    behind = np.array([[-2.7, 0.0], [0.0, 2.7], [-1.9, -1.9]])
    for place in (Pose2(), Pose2(1.3, -0.7, 0.0), Pose2(20.0, 20.0, 0.0)):
        grid = OccupancyGrid(0.05, MapConfig())
        grid.integrate(scan, place, TRUSTED_M)
        assert (grid.log_odds_at(place.apply(behind)) < -0.05).all()
