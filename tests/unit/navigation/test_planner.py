# SPDX-License-Identifier: MIT
"""Where the robot can drive, and the paths it gets."""

from dataclasses import replace

import numpy as np
import pytest
from exploring import RADIUS_M, bench, grid_of, plan
from scipy.spatial import cKDTree

from ins_robot.config import LrfConfig, MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.planner import dense_points_m
from ins_robot.navigation.planner import plan as plan_path
from ins_robot.navigation.squeeze import find_squeezes
from ins_robot.navigation.terrain import BodyRules, driven_cells, survey_terrain

BODY = BodyRules(radius_m=RADIUS_M, clearance_m=0.03)


def two_rooms(door_m, phase_m=0.0):
    y = 2.0 + phase_m
    return plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, y, 2.7, y + door_m), (2.7, 0.5, 5.5, 3.5))


def path_to(grid, start, goal_m, heading_rad=0.0):
    terrain = survey_terrain(grid, start, BODY)
    cell = tuple(int(v) for v in grid.cells(np.array(goal_m)))
    return terrain, cell, plan_path(terrain, start, cell, heading_rad)


def least_room_m(world, path):
    points = dense_points_m(path.points_m, 0.01).tolist()
    return min(world.clearance.nearest_wall(x, y).distance_m for x, y in points)


@pytest.mark.parametrize("door_m", [0.5, 0.55, 0.6, 0.9])
@pytest.mark.parametrize("phase_m", [0.0, 0.35])
def test_a_door_the_body_fits_is_passed_without_touching(door_m, phase_m):
    world = two_rooms(door_m, phase_m)
    terrain, cell, path = path_to(grid_of(world), Pose2(1.0, 1.0, 0.0), (4.5, 1.2))
    assert np.isfinite(terrain.cost_m[cell])
    assert least_room_m(world, path) >= RADIUS_M
    np.testing.assert_allclose(path.points_m[-1], (4.5, 1.2), atol=0.05)


def test_a_door_narrower_than_the_body_is_not():
    grid = grid_of(two_rooms(0.35))
    terrain = survey_terrain(grid, Pose2(1.0, 1.0, 0.0), BODY)
    assert not terrain.is_reachable[tuple(grid.cells(np.array([4.5, 1.2])))]


def test_the_way_keeps_clear_of_walls_where_there_is_room():
    world = plan(6, 4, (0.5, 0.5, 5.5, 3.5), walls=[(2.5, 0.5, 3.0, 1.5)])
    _, _, path = path_to(grid_of(world), Pose2(1.0, 0.9, 0.0), (4.8, 0.9))
    points = dense_points_m(path.points_m, 0.01)
    beside = points[(points[:, 0] > 2.4) & (points[:, 0] < 3.1)]
    room = [world.clearance.nearest_wall(x, y).distance_m for x, y in beside.tolist()]
    assert min(room) > RADIUS_M + 0.08


def test_unknown_ground_is_never_entered():
    world = plan(6, 4, (0.5, 0.5, 5.5, 3.5))
    is_known = np.ones(world.is_occupied.shape, bool)
    is_known[10:60, 60:66] = False  # the straight way lies unseen, a way round is known
    grid = grid_of(world, is_known)
    _, _, path = path_to(grid, Pose2(1.0, 1.0, 0.0), (5.0, 1.0))
    points = dense_points_m(path.points_m, 0.01)
    unseen = (np.argwhere(~is_known)[:, ::-1] + 0.5) * 0.05
    away = np.hypot(*(points[:, None] - unseen[None]).transpose(2, 0, 1))
    assert away.min() >= RADIUS_M


def test_a_single_unknown_cell_may_be_a_leg():
    world = plan(6, 4, (0.5, 0.5, 5.5, 3.5))
    is_known = np.ones(world.is_occupied.shape, bool)
    is_known[40, 60] = False
    _, _, path = path_to(grid_of(world, is_known), Pose2(1.0, 2.025, 0.0), (5.0, 2.025))
    leg = np.array([3.025, 2.025])
    away = np.hypot(*(dense_points_m(path.points_m, 0.01) - leg).T)
    assert away.min() >= RADIUS_M


def test_a_robot_inside_fresh_inflation_gets_out():
    world = plan(6, 4, (0.5, 0.5, 5.5, 3.5))
    start = Pose2(0.62, 2.0, 0.0)  # 0.12 m from the wall, by the map
    _, _, path = path_to(grid_of(world), start, (4.0, 2.0))
    points = dense_points_m(path.points_m, 0.01).tolist()
    room = [world.clearance.nearest_wall(x, y).distance_m for x, y in points]
    assert room[0] == min(room)
    assert room[-1] > RADIUS_M


def test_an_open_way_is_straight_and_turns_evenly():
    _, _, path = path_to(
        grid_of(plan(8, 6, (0.5, 0.5, 7.5, 5.5))), Pose2(2, 2, 0.0), (6, 4), 2.0
    )
    straight = np.hypot(*(path.points_m[-1] - path.points_m[0]))
    assert path.length_m <= 1.02 * straight
    assert path.headings_rad[0] == pytest.approx(0.0)
    assert path.headings_rad[-1] == pytest.approx(2.0)
    assert (np.diff(path.headings_rad) >= 0.0).all()


def test_turning_on_the_spot_is_a_path_of_two_points():
    _, _, path = path_to(grid_of(plan(4, 4, (0.5, 0.5, 3.5, 3.5))), Pose2(2.02, 2.02, 0.3),
                         (2.02, 2.02), -1.0)  # fmt: skip
    assert path.length_m == 0.0
    np.testing.assert_allclose(path.headings_rad, [0.3, -1.0])


def test_costs_grow_along_every_way():
    grid = grid_of(two_rooms(0.9))
    terrain, cell, _ = path_to(grid, Pose2(1.0, 1.0, 0.0), (4.5, 1.2))
    way = terrain.way_to(cell)
    costs = terrain.cost_m[way[:, 0], way[:, 1]]
    assert costs[0] == 0.0
    assert (np.diff(costs) > 0.0).all()
    assert np.abs(np.diff(way, axis=0)).max() == 1


def test_a_later_scan_cannot_lock_the_robot_in():
    """A lane once driven stays open though by the map it is too narrow by half a cell."""
    world = plan(6, 4, (0.5, 0.5, 2.0, 3.5), (2.0, 1.8, 3.5, 2.2), (3.5, 0.5, 5.5, 3.5))
    grid, start, home = grid_of(world), Pose2(4.5, 2.0, 0.0), np.array([1.0, 2.0])
    way = dense_points_m(np.array([home, [4.5, 2.0]]), 0.04)
    home_cell = tuple(int(v) for v in grid.cells(home))
    assert not survey_terrain(grid, start, BODY).is_reachable[home_cell]
    terrain = survey_terrain(grid, start, BODY, odd=driven_cells(grid, way, BODY))
    path = plan_path(terrain, start, home_cell, 0.0)
    inside = path.points_m[(path.points_m[:, 0] > 2.2) & (path.points_m[:, 0] < 3.3)]
    assert len(inside) > 5
    np.testing.assert_allclose(inside[:, 1], 2.0, atol=1e-9)  # as it was driven, not by cells


def test_a_wall_across_the_driven_way_closes_it():
    world = plan(6, 4, (0.5, 0.5, 2.0, 3.5), (2.0, 1.8, 3.5, 2.2), (3.5, 0.5, 5.5, 3.5),
                 walls=[(2.6, 1.8, 2.7, 2.2)])  # fmt: skip
    grid = grid_of(world)
    way = dense_points_m(np.array([[1.0, 2.0], [4.5, 2.0]]), 0.04)
    odd = driven_cells(grid, way, BODY)
    terrain = survey_terrain(grid, Pose2(4.5, 2.0, 0.0), BODY, odd=odd)
    assert not terrain.is_reachable[tuple(grid.cells(np.array([1.0, 2.0])))]


@pytest.mark.parametrize("phase_m", [0.0, 0.0125, 0.025, 0.04])
def test_a_passage_with_two_centimetres_to_spare_is_found_by_the_end_points(phase_m):
    """0.45 m wide, anywhere on the map's lattice: the cells' centres alone miss it."""
    world = plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, 1.8, 2.7, 2.25), (2.7, 0.5, 5.5, 3.5))
    start = Pose2(1.6 + phase_m, 2.1 + phase_m, 0.0)
    robot = bench.BenchRobot(world, start, LrfConfig(), RADIUS_M)
    grid = OccupancyGrid(0.05, MapConfig())
    for x in (0.0, 2.2):  # seen from both sides
        robot.pose = Pose2(x, 0.0, 0.0)
        grid.integrate(robot.scan(np.pi), robot.pose, 3.0)
    odd = find_squeezes(grid, BODY, np.zeros(grid.shape, bool))
    here, goal = Pose2(), (2.2, 0.0)
    terrain = survey_terrain(grid, here, BODY, odd=odd)
    cell = tuple(int(v) for v in grid.cells(np.array(goal)))
    path = plan_path(terrain, here, cell, 0.0)
    points = start.apply(dense_points_m(path.points_m, 0.01)).tolist()
    assert min(world.clearance.nearest_wall(x, y).distance_m for x, y in points) >= RADIUS_M


def test_one_stray_reading_does_not_close_a_narrow_passage():
    """The last surface a beam meets at a corner, or a node a bit beside its place."""
    world = plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, 1.8, 2.7, 2.25), (2.7, 0.5, 5.5, 3.5))
    start = Pose2(1.6, 2.1, 0.0)
    robot = bench.BenchRobot(world, start, LrfConfig(), RADIUS_M)
    grid = OccupancyGrid(0.05, MapConfig())
    for x in (0.6, 1.3):
        robot.pose = Pose2(x, 0.0, 0.0)
        scan = robot.scan(np.pi)
        x_m, y_m = start.apply(robot.pose.apply(scan.points_lrf_m())).T
        on_face = np.flatnonzero((abs(x_m - 2.6) < 0.06) & (y_m < 1.805))
        ranges = scan.ranges_m.copy()
        if x > 1.0:
            beam = np.flatnonzero(scan.is_valid)[on_face[len(on_face) // 2]]
            ranges[beam] *= (2.1 - 1.823) / (2.1 - 1.8)
            stray_x_m = start.x_m + x + ranges[beam] * np.cos(scan.bearings_rad[beam])
        grid.integrate(replace(scan, ranges_m=ranges), robot.pose, 3.0)
    assert len(on_face) > 3
    odd = find_squeezes(grid, BODY, np.zeros(grid.shape, bool))
    inside = start.apply(odd.places_m)
    assert (np.abs(inside[:, 0] - stray_x_m) < 0.03).any()


def test_a_post_of_one_reading_is_no_stray_one():
    """A centimetre thick, and so near to a wall that the body does not fit between."""
    world = plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, 1.8, 2.7, 2.25), (2.7, 0.5, 5.5, 3.5))
    grid = grid_of(world)
    post_m = np.array([[2.6, 2.21]])
    walls = cKDTree(np.concatenate([grid.walls().data, post_m]))
    grid.walls_near = lambda points_m: walls
    odd = find_squeezes(grid, BODY, np.zeros(grid.shape, bool))
    away = np.hypot(*(odd.places_m - post_m).T)
    assert away.min() > RADIUS_M


def test_no_squeeze_is_found_where_the_body_does_not_fit():
    world = plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, 1.8, 2.7, 2.2), (2.7, 0.5, 5.5, 3.5))
    odd = find_squeezes(grid_of(world), BODY, np.zeros((128, 128), bool))
    assert not ((odd.places_m[:, 0] > 2.5) & (odd.places_m[:, 0] < 2.7)).any()


@pytest.mark.parametrize("is_narrow", [True, False])
def test_an_unknown_speck_in_the_post_of_a_narrow_door_is_no_leg_but_one_at_a_wall_may_be(
    is_narrow,
):
    world = plan(6, 4, (0.5, 0.5, 2.5, 3.5), (2.5, 1.8, 2.7, 2.25), (2.7, 0.5, 5.5, 3.5))
    speck_m, beside_m = (
        ((2.625, 2.275), (2.625, 2.025)) if is_narrow else ((4.0, 3.525), (4.0, 3.275))
    )
    is_known = np.ones(world.is_occupied.shape, bool)
    is_known[int(speck_m[1] / 0.05), int(speck_m[0] / 0.05)] = False
    grid = grid_of(world, is_known)
    start, at = Pose2(1.0, 2.0, 0.0), tuple(grid.cells(np.array(beside_m)))
    ground = survey_terrain(grid, start, BODY)
    assert not np.isfinite(ground.factor[at])
    odd = find_squeezes(grid, BODY, np.zeros(grid.shape, bool))
    assert np.isfinite(survey_terrain(grid, start, BODY, odd=odd).factor[at]) == is_narrow
