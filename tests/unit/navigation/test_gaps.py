# SPDX-License-Identifier: MIT
"""Gaps and walls told apart in scans of rooms whose openings are known."""

import numpy as np
import pytest
from exploring import FORWARD, FULL, plan, robot_at, rules, scan_of

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import GapState, find_gaps

BEARINGS = np.radians(np.arange(-180, 180))


def gaps_of(world, x_m, y_m, sector=FULL, heading_rad=0.0, **changes):
    scan = robot_at(world, x_m, y_m, heading_rad).scan(sector[1])
    return find_gaps(scan, Pose2(), sector, rules(**changes))


def test_a_closed_room_has_no_gap():
    assert gaps_of(plan(5, 5, (1, 1, 4, 4)), 2.3, 2.6) == []


@pytest.mark.parametrize("heading_deg", [0, 40, 180])
def test_the_limits_of_the_sector_are_no_gaps(heading_deg):
    room = plan(5, 5, (1, 1, 4, 4))
    assert gaps_of(room, 2.3, 2.6, FORWARD, np.radians(heading_deg)) == []


@pytest.mark.parametrize("width_m", [0.6, 0.9, 1.4])
def test_a_door_to_a_long_room_has_the_doors_width_and_place(width_m):
    world = plan(12, 5, (1, 1, 4, 4), (4, 2.5 - width_m / 2, 4.1, 2.5 + width_m / 2),
                 (4.1, 1, 11.5, 4))  # fmt: skip
    (gap,) = gaps_of(world, 2.0, 2.5)
    assert gap.width_m == pytest.approx(width_m, abs=0.1)
    np.testing.assert_allclose(gap.centroid_m, [2.0, 0.0], atol=0.08)
    np.testing.assert_allclose(gap.outward, [1.0, 0.0], atol=0.1)
    assert gap.state is GapState.UNEXPLORED


def test_a_gap_narrower_than_the_robot_is_kept_and_says_why():
    world = plan(12, 5, (1, 1, 4, 4), (4, 2.35, 4.1, 2.65), (4.1, 1, 11.5, 4))
    (gap,) = gaps_of(world, 2.0, 2.5)
    assert gap.state is GapState.TOO_NARROW
    assert "robot 0.40 m" in gap.why


def test_behind_a_corner_the_gap_spans_the_passage():
    # an L: from its lower arm the upper one is hidden behind the corner at (3, 2)
    world = plan(6, 6, (1, 1, 4.5, 2), (3, 2, 4.5, 5))
    (gap,) = gaps_of(world, 1.5, 1.4)
    corner = np.array([3.0, 2.0]) - [1.5, 1.4]
    assert min(np.hypot(*(gap.ends_m - corner).T)) < 0.1
    assert gap.width_m == pytest.approx(1.5, abs=0.15)  # to the wall across, not to the jump
    assert gap.outward[1] > 0.8  # up into the hidden arm


def test_a_post_casts_a_gap_on_both_sides():
    world = plan(7, 5, (0.5, 0.5, 5.5, 4.5), walls=[(2.5, 2.4, 2.7, 2.6)])
    gaps = gaps_of(world, 1.0, 2.5, gap_range_m=6.0)
    behind = [gap for gap in gaps if gap.centroid_m[0] > 1.4]
    assert len(behind) == 2
    assert {np.sign(gap.outward[1]) for gap in behind} == {-1.0, 1.0}


def test_a_few_lost_beams_are_no_gap_and_many_are():
    ranges = np.full(360, 2.0)
    ranges[100:104] = np.nan
    assert find_gaps(scan_of(ranges, BEARINGS), Pose2(), FULL, rules()) == []
    ranges[100:130] = np.nan
    (gap,) = find_gaps(scan_of(ranges, BEARINGS), Pose2(), FULL, rules())
    middle = BEARINGS[99:131].mean()
    np.testing.assert_allclose(
        gap.centroid_m / np.hypot(*gap.centroid_m), [np.cos(middle), np.sin(middle)], atol=1e-9
    )


def test_a_run_that_passes_the_first_beam_is_one_gap():
    ranges = np.full(360, 2.0)
    ranges[:15] = ranges[-15:] = 5.0
    (gap,) = find_gaps(scan_of(ranges, BEARINGS), Pose2(), FULL, rules())
    np.testing.assert_allclose(gap.outward, [-1.0, 0.0], atol=0.02)


def test_a_hall_without_any_reading_is_open_on_all_sides():
    gaps = find_gaps(scan_of(np.full(360, np.nan), BEARINGS), Pose2(), FULL, rules())
    directions = sum(gap.outward for gap in gaps)
    assert len(gaps) >= 4
    np.testing.assert_allclose(directions, [0.0, 0.0], atol=0.1)
    assert all(gap.is_open for gap in gaps)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_scans_of_hardly_any_beam_have_no_gap(count):
    scan = scan_of(np.full(count, 1.0), np.linspace(0.0, 0.1, count))
    assert find_gaps(scan, Pose2(), FULL, rules()) == []


def test_the_place_of_the_sensor_on_the_body_shifts_the_gaps():
    world = plan(12, 5, (1, 1, 4, 4), (4, 2.1, 4.1, 2.9), (4.1, 1, 11.5, 4))
    scan = robot_at(world, 2.0, 2.5).scan(np.pi)
    (here,) = find_gaps(scan, Pose2(), FULL, rules())
    (there,) = find_gaps(scan, Pose2(0.1, -0.05, 0.0), FULL, rules())
    np.testing.assert_allclose(there.centroid_m - here.centroid_m, [0.1, -0.05], atol=1e-9)
