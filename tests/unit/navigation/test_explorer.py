# SPDX-License-Identifier: MIT
"""The exploration as a whole, on small worlds: it goes where it should, and it always ends."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from exploring import (
    FULL,
    RADIUS_M,
    bench,
    configured,
    explore,
    grid_of,
    plan,
    robot_at,
    scan_of,
)

from ins_robot.config import Config, ExplorationConfig, LrfConfig, RobotConfig
from ins_robot.errors import StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.auto import Auto
from ins_robot.navigation.blindness import SCANS_MAX
from ins_robot.navigation.decisions import NO_GAP
from ins_robot.navigation.explorer import Drive, Explorer, Finished
from ins_robot.navigation.gaps import GapState
from ins_robot.navigation.guard import SeenGuard
from ins_robot.navigation.scan_place import ScanPlaces
from ins_robot.navigation.second_chances import SecondChances
from ins_robot.navigation.unseen import STRIKES, BarrenEdges, survey_unseen
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells

ROOMS = plan(
    9, 6,
    (0.5, 0.5, 3, 5.5), (3, 2.2, 3.1, 3.0), (3.1, 0.5, 6, 5.5), (6, 4, 6.1, 4.8),
    (6.1, 0.5, 8.5, 5.5),
)  # fmt: skip
START = (1.2, 2.4)


def covered(world, x_m, y_m, run):
    visible = visible_cells(world, Pose2(x_m, y_m, 0.0), RADIUS_M, 6.0)
    return coverage(run.robot.seen.is_seen(), visible)


@pytest.fixture(scope="module")
def run():
    return explore(ROOMS, *START)


def test_three_rooms_are_seen_whole_and_untouched(run):
    assert isinstance(run.decision, Finished)
    assert run.decision.is_complete
    assert covered(ROOMS, *START, run) >= 0.99
    assert run.robot.contacts == 0
    assert run.scans < 30


def test_no_gap_stays_open_at_the_end(run):
    left = [gap for _, gap in run.explorer.graph.gaps() if gap.is_open]
    assert left == []
    assert all(gap.why for _, gap in run.explorer.graph.gaps())


@pytest.mark.parametrize(("strategy", "wide_m"), [("min-gap", 0.2), ("auto", 0.38)])
def test_what_was_left_is_told_with_its_reason(strategy, wide_m):
    """To `auto` a slit narrower than `frontier_min_m` is none."""
    door = (4, 2.4, 4.1, 2.4 + wide_m)
    slit = plan(9, 5, (0.5, 0.5, 4, 4.5), door, (4.1, 0.5, 8.5, 4.5))
    ended = explore(slit, 1.5, 2.2, configured(strategy=strategy)).decision
    told = [(left.state, left.why) for left in (*ended.left, *ended.unseen)]
    assert any(state == GapState.TOO_NARROW and "robot 0.40 m" in why for state, why in told)


def test_the_robot_arrives_facing_what_it_came_for():
    for run in bench.explore(ROOMS, Pose2(*START, 0.0), Config()):
        if isinstance(run.decision, Finished) or run.decision.gap_id == NO_GAP:
            break
        node = next(n for n in run.explorer.graph.nodes if n.id == run.decision.node_id)
        gap = node.gaps[run.decision.gap_id]
        heading = run.decision.path.headings_rad[-1]
        facing = np.array([math.cos(heading), math.sin(heading)])
        ahead = node.centroid_m(gap) - run.decision.path.points_m[-1]
        beyond = Pose2(0.0, 0.0, node.pose.heading_rad).apply(gap.outward[None])[0]
        is_ahead = facing @ ahead > 0.0 or facing @ beyond > 0.0  # or it stands past the gap
        assert is_ahead or gap.width_m > 2.0, run.decision.reason
        np.testing.assert_allclose(
            run.decision.path.points_m[0], [run.robot.pose.x_m, run.robot.pose.y_m]
        )


def test_the_graph_holds_what_its_file_promises(run):
    graph = run.explorer.as_json()
    assert json.loads(json.dumps(graph)) == graph
    for node in graph["nodes"]:
        assert {
            "id",
            "stamp_s",
            "x_m",
            "y_m",
            "heading_rad",
            "sector",
            "neighbours",
            "gaps",
        } <= (node.keys())
        for gap in node["gaps"]:
            assert {"id", "centroid", "width_m", "state", "why"} <= gap.keys()
            assert gap["state"] in set(GapState)
    by_id = {node["id"]: node for node in graph["nodes"]}
    for node in graph["nodes"]:
        assert all(node["id"] in by_id[other]["neighbours"] for other in node["neighbours"])


def test_a_closed_room_takes_one_scan():
    run = explore(plan(5, 5, (1, 1, 4, 4)), 2.3, 2.6)
    assert (run.scans, run.robot.path_m) == (1, 0.0)


def test_the_same_calls_give_the_same_answers(run):
    again = explore(ROOMS, *START)
    assert again.explorer.as_json() == run.explorer.as_json()


@pytest.mark.parametrize("strategy", ["min-gap", "max-gap", "backtrack"])
@pytest.mark.parametrize("guard", [True, False])
def test_every_strategy_ends_by_itself(strategy, guard):
    run = explore(ROOMS, *START, configured(strategy=strategy, visibility_guard=guard))
    assert run.decision.is_complete
    assert run.robot.contacts == 0
    if guard:
        assert covered(ROOMS, *START, run) >= 0.99


@pytest.mark.parametrize("silent", [0.5, 1.0])
def test_glass_all_around_does_not_keep_the_robot_for_ever(silent):
    """Where beams are lost for good, scans stop adding and the exploration ends."""
    world = plan(6, 6, (0.5, 0.5, 5.5, 5.5))
    robot = robot_at(world, 3.0, 3.0)
    config = Config()
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    grid = grid_of(world, np.zeros(world.is_occupied.shape, bool))
    grid = type(grid)(config.map.resolution_m, config.map)
    lost = np.random.default_rng(0).random(360) < silent
    for number in range(60):
        scan = robot.scan(np.pi)
        ranges = np.where(lost[: len(scan.ranges_m)], np.nan, scan.ranges_m)
        scan = scan_of(ranges, scan.bearings_rad)
        grid.integrate(scan, robot.pose, config.lrf.range_trusted_m)
        explorer.observe(number, float(number), robot.pose, scan, FULL)
        decision = explorer.decide(robot.pose, grid)
        if isinstance(decision, Finished):
            break
        robot.drive(decision.path)
    assert isinstance(decision, Finished)


def start_of(config=None):
    """An explorer after the first scan in ROOMS, with its first decision."""
    config = config or Config()
    robot = robot_at(ROOMS, *START)
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    grid = bench.OccupancyGrid(config.map.resolution_m, config.map)
    scan = robot.scan(np.pi)
    grid.integrate(scan, robot.pose, config.lrf.range_trusted_m)
    explorer.observe(0, 0.0, robot.pose, scan, FULL)
    return explorer, grid, explorer.decide(robot.pose, grid)


def test_a_refused_goal_waits_is_tried_again_and_then_given_up():
    explorer, grid, decision = start_of()
    tries = {}
    while isinstance(decision, Drive):
        name = (decision.node_id, decision.gap_id)
        tries[name] = tries.get(name, 0) + 1
        explorer.report_failure(decision, "in the way")
        decision = explorer.decide(Pose2(), grid)
        assert len(tries) < 30
    assert decision.is_complete
    assert tries
    assert max(tries.values()) == 2
    given_up = [gap for gap in decision.left if "in the way" in gap.why]
    assert given_up


def test_another_goal_comes_before_the_refused_one():
    open_hall = plan(20, 20, (0.5, 0.5, 19.5, 19.5))
    robot = robot_at(open_hall, 10.0, 10.0)
    config = Config()
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    grid = bench.OccupancyGrid(config.map.resolution_m, config.map)
    scan = robot.scan(np.pi)
    grid.integrate(scan, robot.pose, config.lrf.range_trusted_m)
    grid.log_odds[:] = grid_disc(grid, 2.8)
    explorer.observe(0, 0.0, robot.pose, scan, FULL)
    first = explorer.decide(robot.pose, grid)
    explorer.report_failure(first, "blocked")
    second = explorer.decide(robot.pose, grid)
    assert isinstance(second, Drive)
    assert second.gap_id != first.gap_id


def grid_disc(grid, radius_m):
    """Free ground known in a disc about the origin and nowhere else."""
    cells = np.argwhere(np.ones(grid.shape, bool))
    away = np.hypot(*grid.metres(cells).T)
    return np.where(away < radius_m, -3.0, 0.0).reshape(grid.shape).astype(np.float32)


def test_only_the_last_decision_can_fail():
    explorer, _, decision = start_of()
    with pytest.raises(StateError):
        explorer.report_failure(replace(decision), "not this one")


def test_a_decision_needs_a_scan():
    explorer = Explorer(ExplorationConfig(), RobotConfig(), LrfConfig())
    with pytest.raises(StateError, match="observe"):
        explorer.decide(Pose2(), grid_of(ROOMS))


def test_gaps_move_with_their_node():
    explorer, _, _ = start_of()
    (node,) = explorer.graph.nodes
    before = [(node.centroid_m(gap), gap.width_m) for gap in node.gaps]
    moved = Pose2(0.3, -0.2, 0.4)
    explorer.relocate(moved.as_array()[None])
    for gap, (centroid, width) in zip(node.gaps, before, strict=True):
        np.testing.assert_allclose(node.centroid_m(gap), moved.apply(centroid[None])[0])
        assert gap.width_m == width
    with pytest.raises(StateError, match="2 poses for 1"):
        explorer.relocate(np.zeros((2, 3)))


def test_the_limit_on_scans_ends_the_run_and_says_so():
    ended = explore(ROOMS, *START, configured(max_scans=3, return_home=False))
    assert ended.scans == 3
    assert not ended.decision.is_complete
    assert "max_scans" in ended.decision.reason
    assert ended.decision.left


@pytest.mark.parametrize("ends", ["by a limit", "blindly"])
def test_a_run_that_ends_early_says_what_it_has_seen_by_then(ends):
    """A chooser of places asks for no gap on its way."""
    config = configured(strategy="auto", max_scans=5 if ends == "by a limit" else 99)
    for run in bench.explore(ROOMS, Pose2(*START, 0.0), config):
        if ends == "blindly" and run.scans == 5:
            run.explorer.blindness.scans = SCANS_MAX
            final = run.explorer.decide(run.robot.pose, run.grid)
            break
        final = run.decision
    assert isinstance(final, Finished)
    explorer = run.explorer
    unseen = survey_unseen(run.grid, config.exploration.frontier_min_m, explorer._barren)
    gaps = list(explorer.graph.gaps())
    stale = [
        (node.id, gap.id)
        for node, gap in gaps
        if gap.is_open and not len(SeenGuard().targets_m(unseen, explorer.graph, node, gap))
    ]
    assert gaps
    assert stale == []


def test_the_robot_stays_within_the_radius():
    radius_m = 2.5
    robot = None
    for run in bench.explore(ROOMS, Pose2(*START, 0.0), configured(max_radius_m=radius_m)):
        robot = run.robot
        if isinstance(run.decision, Drive):
            assert np.hypot(*run.decision.path.points_m.T).max() <= radius_m + 0.05
    assert robot.path_m > 0.0
    assert any("max_radius_m" in gap.why for gap in run.decision.left)


def test_a_door_to_a_room_where_nothing_answers_is_passed():
    """From before the door every reading in it is silent; quiet ground is the last resort."""
    hall = plan(14, 13, (0.5, 5.0, 3.5, 8.0), (3.5, 6.2, 3.6, 6.8), (3.6, 0.5, 13.5, 12.5))
    run = None
    for run in bench.explore(hall, Pose2(2.0, 6.5, 0.0), Config()):
        if run.robot.pose.x_m > 3.0:
            break
    assert run is not None
    assert run.robot.pose.x_m > 3.0, run.decision
    assert run.robot.contacts == 0


@pytest.mark.parametrize("strategy", ["auto", "tsp-frontier", "nearest-frontier"])
def test_a_strategy_that_chooses_places_ends_with_all_seen(strategy):
    run = explore(ROOMS, *START, configured(strategy=strategy))
    assert run.decision.is_complete
    assert run.robot.contacts == 0
    assert covered(ROOMS, *START, run) >= 0.99
    graph = run.explorer.as_json()
    assert any(gap["kind"] == "edge" for node in graph["nodes"] for gap in node["gaps"])


def test_auto_scans_hardly_more_often_than_the_paper_and_drives_less():
    paper, auto = (
        explore(ROOMS, *START, configured(strategy=name, return_home=False))
        for name in ("min-gap", "auto")
    )
    assert auto.scans <= 1.5 * paper.scans
    assert auto.robot.path_m < paper.robot.path_m


def test_a_chooser_without_an_answer_is_not_asked_again_for_each_refused_gap(monkeypatch):
    asked, refused = [], []

    def refuse(places, scene, node, gap):
        refused.append(gap)
        gap.set(GapState.UNREACHABLE, "for the test")

    monkeypatch.setattr(Auto, "aim", lambda auto, outlook: asked.append(outlook))
    monkeypatch.setattr(ScanPlaces, "choose", refuse)
    _, _, decision = start_of(configured(strategy="auto"))
    assert isinstance(decision, Finished)
    assert len(refused) > 2
    assert len(asked) <= 2  # before narrow passages are looked for, and after


def test_a_place_aimed_at_again_is_the_same_gap():
    explorer, grid, first = start_of(configured(strategy="auto"))
    count = len(list(explorer.graph.gaps()))
    again = explorer.decide(Pose2(), grid)  # as a run does whose way is blocked
    assert again.reason == first.reason
    assert (again.node_id, again.gap_id) == (first.node_id, first.gap_id)
    assert len(list(explorer.graph.gaps())) == count


def test_a_place_refused_twice_is_given_up_and_another_one_chosen():
    explorer, grid, first = start_of(configured(strategy="auto"))
    decision = first
    (aimed,) = explorer._aimed
    tries = 0
    while isinstance(decision, Drive) and decision.gap_id != NO_GAP:
        tries += (decision.node_id, decision.gap_id) == (first.node_id, first.gap_id)
        explorer.report_failure(decision, "in the way")
        decision = explorer.decide(Pose2(), grid)
    assert tries == 2
    assert aimed.gap.state is GapState.UNREACHABLE
    assert aimed.gap.why == "given up after 2 tries: in the way"


def test_a_second_chance_pardons_a_place_that_was_out_of_reach_once():
    explorer, _, _ = start_of()
    (node,) = explorer.graph.nodes
    vain, targets = BarrenEdges(), np.array([[2.0, 1.0], [2.5, 1.0]])
    chances = SecondChances(explorer.graph, BarrenEdges(), vain)
    gaps = [node.gaps[0], replace(node.gaps[0], id=1)]
    for gap, is_pardoned in zip(gaps, (True, False), strict=True):
        vain.strike(targets, STRIKES)
        chances.refused(node, gap, targets)
        chances.stands_at(Pose2())
        gap.set(GapState.UNREACHABLE, "for the test")
        assert not chances.reopen(Pose2(0.1, 0.0, 0.0))
        assert vain.mask(targets).all()
        assert chances.reopen(Pose2(0.8, 0.0, 0.0))
        assert vain.mask(targets).any() != is_pardoned


@pytest.mark.parametrize("power", ["on_demand", "continuous"])
def test_only_a_robot_whose_lrf_is_always_on_looks_on_the_way(power):
    lrf = replace(LrfConfig(), power=power)
    explorer = Explorer(ExplorationConfig(strategy="auto"), RobotConfig(), lrf)
    run = next(iter(bench.explore(ROOMS, Pose2(*START, 0.0), configured(strategy="auto"))))
    for node in run.explorer.graph.nodes:
        explorer.graph.add(node)
    scene = explorer._look_around(run.robot.pose, run.grid)
    outlook = scene.outlook(6.0, BarrenEdges(), explorer.graph)
    assert outlook.looks_on_the_way == (power == "continuous")
