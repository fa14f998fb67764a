# SPDX-License-Identifier: MIT
"""Boundary, no-go zones and virtual walls: the body stays off them, and the run says so."""

import numpy as np
import pytest
from changing_world import tell
from exploring import RADIUS_M, bench, configured, explore, grid_of, plan
from scipy.spatial import cKDTree

from ins_robot.config import ExplorationConfig
from ins_robot.control.collision_guard import CollisionGuard
from ins_robot.errors import InputError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.zones import Zone, ZoneKind, zone_of, zones_as_json, zones_of
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.explorer import Drive, Explorer
from ins_robot.navigation.planner import dense_points_m, way_points_m
from ins_robot.navigation.terrain import BodyRules, survey_terrain

TWO_ROOMS = plan(8, 5, (0.5, 0.5, 3.5, 4.5), (3.5, 2.0, 3.6, 2.9), (3.6, 0.5, 7.5, 4.5))
START = (1.5, 2.2)
KEEP_M = 0.23
DOOR_WALL = Zone(name="door", kind=ZoneKind.WALL, points_m=((2.05, -0.6), (2.05, 1.0)))
STAIRS = Zone(
    name="stairs",
    kind=ZoneKind.NO_GO,
    points_m=((3.5, -1.0), (5.0, -1.0), (5.0, 1.0), (3.5, 1.0)),
)


def ways_of(config, zones=()):
    """The run's last state, and (N, 2) all places driven through."""
    places, run = [np.zeros((1, 2))], None
    for run in bench.explore(TWO_ROOMS, Pose2(*START, 0.0), config):
        if run.scans == 1 and zones:
            run.explorer.forbid(zones)
        if isinstance(run.decision, Drive) and not (run.scans == 1 and zones):
            places.append(dense_points_m(run.decision.path.points_m, 0.02))
    return run, np.concatenate(places)


def test_the_body_stays_inside_the_boundary():
    boundary = ((-0.9, -1.6), (1.5, -1.6), (1.5, 2.2), (-0.9, 2.2))
    run, places = ways_of(configured(boundary=boundary))
    assert run.robot.path_m > 0.5
    assert places[:, 0].max() <= 1.5 - RADIUS_M
    assert run.decision.is_complete
    assert {left.state for left in run.decision.unseen} == {"outside"}
    assert run.robot.pose.distance_m(Pose2()) <= 0.05


def test_a_virtual_wall_in_the_door_keeps_the_robot_in():
    run, places = ways_of(configured(), (DOOR_WALL,))
    assert places[:, 0].max() <= 2.05 - RADIUS_M
    assert "no_go" in {left.state for left in run.decision.unseen}
    assert any("no-go zone or a virtual wall" in left.why for left in run.decision.unseen)


def test_a_no_go_zone_is_driven_around():
    run, places = ways_of(configured(), (STAIRS,))
    beyond = places[:, 0] > 2.3
    assert beyond.any()
    corner = np.maximum(np.array([3.5, -1.0]) - places, places - np.array([5.0, 1.0]))
    away = np.hypot(*np.clip(corner, 0.0, None).T)
    assert away.min() >= RADIUS_M
    assert run.robot.contacts == 0


def test_a_robot_on_forbidden_ground_may_leave_it():
    grid = grid_of(plan(10, 10, (0.5, 0.5, 9.5, 9.5)))
    bounds = Bounds(ExplorationConfig(), KEEP_M)
    bounds.zones = (
        Zone(name="z", kind=ZoneKind.NO_GO, points_m=((3, 3), (7, 3), (7, 7), (3, 7))),
    )
    here = Pose2(3.4, 5.0, 0.0)
    allowed = bounds.drivable_cells(Pose2(1, 1, 0), grid, here)

    def at(x, y):
        row, col = grid.cells(np.array([x, y]))
        return allowed[row, col]

    assert at(3.4, 5.0)
    assert at(3.2, 5.0)  # outwards
    assert at(2.7, 5.0)
    assert not at(3.8, 5.0)  # deeper in
    assert not at(6.9, 3.1)  # the other side is none of its business


def test_fences_stand_where_the_lines_are():
    triangle = ExplorationConfig(boundary=((-1, -1), (1, -1), (0, 1)))
    bounds = Bounds(triangle, KEEP_M, (DOOR_WALL,))
    fence = bounds.fence_m(Pose2())
    for corner in [(-1, -1), (1, -1), (0, 1), (2.05, -0.6), (2.05, 1.0)]:
        assert np.hypot(*(fence - corner).T).min() < 0.03
    assert len(Bounds(ExplorationConfig(), KEEP_M).fence_m(Pose2())) == 0


def test_of_an_endless_wall_the_guard_knows_what_is_around():
    """And a side counts where it runs through the box, wherever its ends are."""
    points_m = ((-1000.0, -3.0), (1000.0, -3.0), (1000.0, 1000.0), (-990.0, -990.0))
    wall = Zone(name="w", kind=ZoneKind.WALL, points_m=points_m)
    fence = Bounds(ExplorationConfig(), KEEP_M, (wall,)).fence_m(Pose2(2.0, 0.0, 0.0))
    assert len(fence) < 10_000
    assert np.abs(fence - (2.0, 0.0)).max() < 31.0
    for k in range(-27, 30):
        for point in [(k, -3.0), (k, k)]:
            assert np.hypot(*(fence - point).T).min() < 0.011
    away = Bounds(ExplorationConfig(), KEEP_M, (wall,)).fence_m(Pose2(300.0, 200.0, 0.0))
    assert len(away) == 0


def test_many_points_are_refused_as_one():
    config = ExplorationConfig(boundary=((-9, -9), (9, -9), (9, 9), (-9, 9)), max_radius_m=10.0)
    bounds = Bounds(config, KEEP_M, (STAIRS,))
    points = np.random.default_rng(0).uniform(-12.0, 12.0, (3000, 2))
    told = bounds.refusals(Pose2(), points)
    assert told == [bounds.refusal(Pose2(), point) for point in points]
    assert len(set(told)) == 4
    assert bounds.refusals(Pose2(), np.zeros((0, 2))) == []


def test_without_clearance_the_body_keeps_off_a_virtual_wall_all_the_same():
    """Around its end, on ways that the guard lets it drive."""
    config, rng = configured(clearance_m=0.0), np.random.default_rng(0)
    body = BodyRules(radius_m=config.robot.radius_m, clearance_m=0.0)
    grid = grid_of(plan(10, 10, (0.1, 0.1, 9.9, 9.9)))
    guard, middle = CollisionGuard(config.control, body.radius_m), np.array([5.0, 5.0])
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    for turn_rad in rng.uniform(0.0, np.pi, 12):
        along = np.array([np.cos(turn_rad), np.sin(turn_rad)])
        across = np.array([-along[1], along[0]])
        tip = middle + rng.uniform(-0.05, 0.05, 2)
        ends = (tuple(tip.tolist()), tuple((tip - 4.0 * along).tolist()))
        explorer.forbid((Zone(name="w", kind=ZoneKind.WALL, points_m=ends),))
        start = Pose2(*(tip - along + across).tolist(), 0.0)
        allowed = explorer.bounds.drivable_cells(start, grid, start)
        terrain = survey_terrain(grid, start, body, allowed)
        row, col = grid.cells(tip - along - across).tolist()
        points = way_points_m(terrain, start, terrain.way_to((row, col)))
        guard.observe(cKDTree(explorer.bounds.fence_m(start)))
        dense = [tuple(point) for point in dense_points_m(points, 0.02)]
        assert not guard.blocks((start.x_m, start.y_m), dense)


def test_a_place_is_driven_to_and_exploring_goes_on():
    story = tell(TWO_ROOMS, Pose2(*START, 0.0), configured(max_scans=1, return_home=False))
    explorer = story.explorer
    drive = explorer.send_to(np.array([-0.5, -1.0]), story.robot.pose, story.grid)
    np.testing.assert_allclose(drive.path.points_m[-1], [-0.5, -1.0], atol=0.05)
    halfway = Pose2(-0.2, -0.4, 0.0)
    again = explorer.decide(halfway, story.grid)  # the way is looked at again meanwhile
    np.testing.assert_allclose(again.path.points_m[-1], [-0.5, -1.0], atol=0.05)
    explorer.report_failure(again, "blocked")
    after = explorer.decide(halfway, story.grid)
    assert "goto" not in after.reason


@pytest.mark.parametrize(
    ("place", "zones", "why"),
    [
        ((0.0, 2.31), (), "a wall stands there"),
        ((40.0, 2.0), (), "nobody has seen that place"),
        ((4.2, 0.0), (STAIRS,), "no-go zone 'stairs'"),
        ((4.2, 0.0), (DOOR_WALL,), "virtual wall bars the way"),
    ],
)
def test_a_place_out_of_reach_is_refused_in_one_line(place, zones, why):
    run = explore(TWO_ROOMS, *START)
    run.explorer.forbid(zones)
    before = run.explorer.as_json()
    with pytest.raises(StateError, match=why):
        run.explorer.send_to(np.array(place), run.robot.pose, run.grid)
    assert run.explorer.as_json() == before


def test_zones_come_back_from_json():
    zones = (DOOR_WALL, STAIRS)
    assert zones_of(zones_as_json(zones)) == zones
    with pytest.raises(InputError, match="already one"):
        zones_of(zones_as_json((STAIRS, STAIRS)))
    for far in (1000.5, 10**400, float("nan")):
        with pytest.raises(InputError, match="none beyond 1000 m"):
            zone_of({"name": "a", "kind": "wall", "points": [[0, 0], [far, 0]]})
    for kind, what in (("wall", "points"), ("no-go", "corners")):
        with pytest.raises(InputError, match=f"201 {what}, at most 200"):
            zone_of(
                {"name": "a", "kind": kind, "points": [[k, k * k / 999] for k in range(201)]}
            )
    for kind in ("lava", [], None):
        with pytest.raises(InputError, match="kind must be"):
            zone_of({"name": "a", "kind": kind, "points": [[0, 0], [1, 0], [0, 1]]})
