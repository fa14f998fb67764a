# SPDX-License-Identifier: MIT
"""It always ends right: complaints of users of other explorers, each as a small world."""

import math
from collections import Counter
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from changing_world import tell
from exploring import (
    RADIUS_M,
    Config,
    bench,
    configured,
    explore,
    grid_of,
    plan,
    robot_at,
)

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan
from ins_robot.navigation import strategies
from ins_robot.navigation.auto import Auto
from ins_robot.navigation.decisions import NO_GAP
from ins_robot.navigation.explorer import Drive, Explorer, Finished
from ins_robot.navigation.way_home import WayHome
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

TWO_ROOMS = plan(8, 5, (0.5, 0.5, 3.5, 4.5), (3.5, 2.0, 3.6, 2.9), (3.6, 0.5, 7.5, 4.5))


def seen_share(world: World, start: Pose2, robot) -> float:
    return coverage(robot.seen.is_seen(), visible_cells(world, start, RADIUS_M, 6.0))


def without_readings(scan: LaserScan) -> LaserScan:
    nothing = np.full(len(scan.ranges_m), np.nan)
    return replace(scan, ranges_m=nothing, range_std_m=nothing)


def with_box(world: World, x0: float, y0: float, x1: float, y1: float) -> World:
    """The world with one more solid box."""
    solid, cell = world.is_occupied.copy(), world.resolution_m
    solid[round(y0 / cell) : round(y1 / cell), round(x0 / cell) : round(x1 / cell)] = True
    return World(solid, cell, world.origin_m, name=world.name)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_start_that_faces_a_wall_at_arm_s_length(heading):
    start = Pose2(0.5 + 0.26, 0.5 + 0.26, heading)  # in a corner
    story = tell(TWO_ROOMS, start)
    assert story.decision.is_complete
    assert story.robot.contacts == 0
    assert seen_share(TWO_ROOMS, start, story.robot) >= 0.99


def test_a_robot_inside_freshly_seen_inflation_gets_out():
    """Something has come nearer to the robot than it would go to it by itself."""
    start = Pose2(2.0, 2.5, 0.0)
    appeared = []

    def come_near(story):
        if story.scans != 2 or appeared:
            return None
        at = story.robot.start @ story.robot.pose
        away = RADIUS_M + 0.005
        appeared.append(at)
        return with_box(
            story.robot.world, at.x_m + away, at.y_m - 0.1, at.x_m + away + 0.2, at.y_m + 0.1
        )

    story = tell(TWO_ROOMS, start, change=come_near)
    assert appeared
    assert story.decision.is_complete
    assert seen_share(TWO_ROOMS, start, story.robot) >= 0.97
    assert story.robot.pose.distance_m(Pose2()) <= 0.1


def test_a_goal_that_a_moved_obstacle_blocks_is_reached_another_way():
    """Seen through the near door, which is then blocked; there is a far one."""
    world = plan(
        8,
        7,
        (0.5, 0.5, 3.5, 6.5),
        (3.5, 2.0, 3.6, 2.9),
        (3.5, 5.2, 3.6, 6.1),
        (3.6, 0.5, 7.5, 6.5),
    )
    blocked = with_box(world, 3.4, 1.9, 3.7, 3.0)
    start = Pose2(1.5, 2.5, 0.0)
    story = tell(world, start, change=lambda story: blocked)
    assert story.decision.is_complete
    assert story.robot.contacts == 0
    assert seen_share(blocked, start, story.robot) >= 0.99
    assert story.robot.pose.distance_m(Pose2()) <= 0.1


def test_a_door_that_closes_for_good_is_told():
    """Seen through, then shut before the robot gets there: it ends, at home, and says so."""
    start = Pose2(1.0, 4.0, 0.0)
    shut = with_box(TWO_ROOMS, 3.5, 1.9, 3.6, 3.0)
    story = tell(TWO_ROOMS, start, change=lambda story: shut)
    assert story.decision.is_complete
    assert story.robot.contacts == 0
    assert story.robot.pose.distance_m(Pose2()) <= 0.1
    assert story.scans < 20


@pytest.mark.parametrize(("strategy", "past_m"), [("min-gap", 4.0), ("auto", 3.8)])
def test_a_door_that_closes_behind_the_robot_leaves_it_where_it_is_and_says_so(
    strategy, past_m
):
    """`auto` looks into the room from just behind its door."""
    start = Pose2(1.0, 2.5, 0.0)
    shut = with_box(TWO_ROOMS, 3.5, 1.9, 3.6, 3.0)

    def close(story):
        at = story.robot.start @ story.robot.pose
        return shut if at.x_m > past_m else None

    story = tell(TWO_ROOMS, start, configured(strategy=strategy), change=close)
    assert "home" in story.decision.reason
    assert "out of reach" in story.decision.reason or "not reached" in story.decision.reason
    assert story.robot.contacts == 0


def test_two_equal_frontiers_are_no_seesaw():
    """A corridor with the robot in its middle: one end, then the other; no place twice."""
    hall = plan(21, 2.5, (0.5, 0.5, 20.5, 2.0))
    start = Pose2(10.5, 1.25, 0.0)
    story = tell(hall, start)
    assert story.decision.is_complete
    assert seen_share(hall, start, story.robot) >= 0.99
    goals = [drive.place for drive in story.drives if drive.gap_id != NO_GAP]
    assert all(a.distance_m(b) > 0.3 for a, b in combinations(goals, 2))
    far = [math.copysign(1.0, goal.x_m) for goal in goals if abs(goal.x_m) > 3.0]
    assert sum(a != b for a, b in pairwise(far)) <= 2, far
    assert story.robot.path_m <= 60.0


def test_deciding_again_on_the_way_keeps_the_goal():
    """Between equal frontiers too: each decision must bring the robot nearer to its goal."""
    hall = plan(21, 2.5, (0.5, 0.5, 20.5, 2.0))
    story = tell(hall, Pose2(10.5, 1.25, 0.0), configured(max_scans=1, return_home=False))
    explorer, grid = story.explorer, story.grid
    config = configured(strategy="min-gap")  # at its aim `auto` is where it can see from
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    scan = story.robot.scan(np.pi)
    explorer.observe(0, 0.0, Pose2(), scan, (0.0, math.pi))
    pose, places = Pose2(), []
    for _ in range(5):
        drive = explorer.decide(pose, grid)
        assert isinstance(drive, Drive)
        places.append(drive.place.x_m)
        ahead = drive.path.points_m[-1] - drive.path.points_m[0]
        step = 0.2 * ahead / np.hypot(*ahead)
        pose = Pose2(pose.x_m + step[0], pose.y_m + step[1], 0.0)
    assert np.ptp(places) < 0.5


def test_decisions_that_show_nothing_new_refuse_their_goals_one_by_one():
    """However often the way is found blocked by what no map shows: no goal for ever."""
    hall = plan(21, 2.5, (0.5, 0.5, 20.5, 2.0))
    story = tell(hall, Pose2(10.5, 1.25, 0.0), configured(max_scans=1, return_home=False))
    explorer = Explorer(Config().exploration, Config().robot, Config().lrf)
    explorer.observe(0, 0.0, Pose2(), story.robot.scan(np.pi), (0.0, math.pi))
    goals = Counter()
    for _ in range(400):
        decision = explorer.decide(Pose2(), story.grid)
        if isinstance(decision, Finished):
            break
        goals[decision.gap_id] += 1
    assert isinstance(decision, Finished)
    assert len(goals) > 1  # the strategy moved on to the others
    assert any("nothing new" in gap.why for gap in decision.left)


def test_a_doorway_two_centimetres_too_narrow_is_left_and_told():
    narrow = plan(
        8, 5, (0.5, 0.5, 3.5, 4.5), (3.5, 2.3, 3.7, 2.68), (3.7, 0.5, 7.5, 4.5),
        resolution_m=0.02,
    )  # fmt: skip
    story = tell(narrow, Pose2(1.5, 1.2, 0.0))
    assert story.decision.is_complete
    assert story.robot.contacts == 0
    assert not any(d.place.x_m + 1.5 > 3.6 for d in story.drives)
    told = [left for left in story.decision.unseen if left.state == "too_narrow"]
    assert told, story.decision.unseen
    assert any(left.x_m + 1.5 > 3.3 for left in told)


def test_what_was_given_up_is_tried_once_more_from_elsewhere():
    """Something that no beam shows stands in the door until the robot has stepped back."""
    start = Pose2(1.5, 2.5, 0.0)
    barred = with_box(TWO_ROOMS, 3.4, 1.9, 3.7, 3.0)

    def move(story):
        has_left = any("another look" in drive.reason for drive in story.drives)
        story.robot.solid = TWO_ROOMS if has_left else barred

    story = tell(TWO_ROOMS, start, change=move)
    assert story.failures >= 2
    assert story.decision.is_complete
    assert seen_share(TWO_ROOMS, start, story.robot) >= 0.99


def test_what_never_lets_the_robot_through_is_told():
    start = Pose2(1.5, 2.5, 0.0)

    def bar(story):
        story.robot.solid = with_box(TWO_ROOMS, 3.4, 1.9, 3.7, 3.0)

    story = tell(TWO_ROOMS, start, change=bar)
    assert story.decision.is_complete
    assert any("given up" in left.why for left in story.decision.unseen)
    assert story.robot.pose.distance_m(Pose2()) <= 0.1


def test_what_was_not_worth_its_way_is_told_so_when_the_run_is_cut_short(monkeypatch):
    looks = iter([True])  # one look for what it shows, then only what little is left
    aim = Auto.aim
    monkeypatch.setattr(Auto, "aim", lambda self, on: aim(self, on) if next(looks, 0) else None)
    monkeypatch.setattr(strategies, "EDGE_PER_WAY", 1e6)  # and none of that worth any way
    hall = (0.5, 2.0, 15.5, 3.0)
    world = plan(
        16, 5, hall, (0.5, 0.5, 3.5, 4.5), (12.5, 0.5, 15.5, 4.5), (7.5, 0.5, 8.5, 4.5)
    )
    config = configured(strategy="auto", max_scans=5)
    story = tell(world, Pose2(2.0, 2.5, 0.0), config=config)
    assert not story.decision.is_complete
    assert "not_worth_it" in {edge.state for edge in story.decision.unseen}


def test_the_robot_comes_home_and_faces_as_it_did():
    run = explore(TWO_ROOMS, 1.5, 2.2, heading=0.7)
    assert run.decision.is_complete
    assert run.robot.pose.distance_m(Pose2()) <= 0.05
    assert abs(run.robot.pose.heading_rad) < 0.05


def test_a_home_that_has_become_too_tight_is_not_tried_again_and_again():
    """Something was put down beside it meanwhile: the robot stops as near as it gets."""
    start = Pose2(1.5, 2.5, 0.0)
    beside = with_box(TWO_ROOMS, 1.2, 2.35, 1.4, 2.65)  # 0.1 m from where the centre was

    def put_down(story):
        return beside if (story.robot.start @ story.robot.pose).x_m > 4.0 else None

    story = tell(TWO_ROOMS, start, change=put_down)
    assert "home was not reached: something stands too near" in story.decision.reason
    assert story.robot.contacts == 0
    assert 0.08 < story.robot.pose.distance_m(Pose2()) < 0.3
    assert sum(drive.reason.startswith("home") for drive in story.drives) <= 3


def test_home_with_all_explored_looks_again_but_not_when_its_time_is_up():
    run = explore(TWO_ROOMS, 1.5, 2.2)
    explorer = run.explorer
    for is_final in (False, True):
        way = WayHome(explorer.graph, explorer.bounds, is_wanted=True)
        way.ending, way.is_final = run.decision, is_final
        assert not way.looks_again(Pose2(1.0, 0.0, 0.0))
        assert way.looks_again(Pose2()) is not is_final


@pytest.mark.parametrize(("strategy", "past_m"), [("min-gap", 4.0), ("auto", 3.0)])
def test_a_robot_whose_lrf_is_covered_stays_where_it_is_and_says_so(strategy, past_m):
    """Not even home: nobody would see what has come into the way."""
    start, scans_before = Pose2(1.5, 2.5, 0.0), []

    def cover(story):
        robot = story.robot
        if (robot.start @ robot.pose).x_m > past_m and not scans_before:
            see = robot.scan
            robot.scan = lambda half_rad: without_readings(see(half_rad))
            scans_before.append(story.scans)

    story = tell(TWO_ROOMS, start, configured(strategy=strategy), change=cover)
    assert "is the LRF covered?" in story.decision.reason
    assert not story.decision.is_complete
    assert story.robot.pose.distance_m(Pose2()) > 1.0
    assert story.scans == scans_before[0] + 2
    assert not any(drive.reason.startswith("home") for drive in story.drives)
    here = story.robot.pose
    assert isinstance(story.explorer.end("the battery is low", here, story.grid), Finished)
    seen = bench.BenchRobot.scan(story.robot, np.pi)
    story.explorer.observe(99, 99.0, here, seen, (0.0, np.pi))  # uncovered
    assert isinstance(story.explorer.end("the battery is low", here, story.grid), Drive)


@pytest.mark.parametrize(("x_m", "scans"), [(15.0, 4), (2.5, 2)], ids=["hall", "wall"])
def test_nothing_in_sight_may_be_a_hall_but_not_beside_a_wall(x_m, scans):
    """A silent scan in a large hall is no fault yet, where a wall must show it is."""
    grid = grid_of(plan(30, 30, (0.5, 0.5, 29.5, 29.5)))
    config, pose = Config(), Pose2(x_m, 15.0, 0.0)
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    silent = without_readings(robot_at(TWO_ROOMS, 1.5, 2.5).scan(np.pi))
    ends = []
    for number in range(scans):
        explorer.observe(number, float(number), pose, silent, (0.0, math.pi))
        ends.append(explorer.decide(pose, grid).reason)
    assert not any("covered" in reason for reason in ends[:-1])
    assert ends[-1].startswith(f"{scans} scans in a row without a reading")


def test_it_stays_where_it_is_when_told_so():
    run = explore(TWO_ROOMS, 1.5, 2.2, configured(return_home=False))
    assert run.decision.is_complete
    assert run.robot.pose.distance_m(Pose2()) > 0.5
