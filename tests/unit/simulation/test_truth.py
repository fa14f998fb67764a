# SPDX-License-Identifier: MIT
"""What is told from the truth: coverage, wall error, pose errors, and their frames."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.config import Config, LrfConfig, SimulationConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import TernaryMap
from ins_robot.simulation import truth
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.seen_area import SeenArea
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

CLEAN = SimulationConfig(drop_out=0.0, drop_out_grazing=0.0, mixed_pixels=0.0)
TURN = np.radians(np.arange(360.0))


@pytest.fixture(scope="module")
def two_rooms():
    """Two rooms of 3 m x 3 m, a door of 0.8 m, and a closed one."""
    walls = np.ones((62, 185), dtype=bool)
    walls[1:61, 1:61] = walls[1:61, 62:122] = walls[1:61, 124:184] = False
    walls[20:36, 61] = False
    return World(walls, 0.05, (1.0, -2.0))


def test_visible_is_what_some_reachable_place_sees(two_rooms):
    visible = visible_cells(two_rooms, Pose2(2.0, -1.0), 0.2, 6.0)
    assert visible[1:61, 1:122][~two_rooms.is_occupied[1:61, 1:122]].all()
    assert not visible[:, 123:].any()  # nobody gets there
    assert not visible[two_rooms.is_occupied].any()


def test_a_large_robot_sees_the_second_room_only_through_the_door(two_rooms):
    visible = visible_cells(two_rooms, Pose2(2.0, -1.0), 0.45, 6.0)
    share = visible[1:61, 62:122].mean()
    assert 0.3 < share < 0.98
    near = visible_cells(two_rooms, Pose2(2.0, -1.0), 0.45, 1.0)
    assert near.sum() < visible.sum()


def scanned(world, poses, simulation=CLEAN):
    config = replace(Config(), simulation=simulation)
    body = RobotBody(world, poses[0], config, np.random.default_rng(0))
    optics = WorldOptics(world, body, LrfConfig(), simulation, np.random.default_rng(1))
    for number, pose in enumerate(poses):
        body.kidnap(pose)
        body.advance(0.01 * (number + 1), (0.0, 0.0, 0.0))
        optics.measure(np.full(360, body.now_s), TURN)
    return optics.seen.is_seen()


def test_coverage_grows_from_half_to_all(two_rooms):
    visible = visible_cells(two_rooms, Pose2(2.5, -0.5), 0.2, 6.0)
    first, second = Pose2(2.5, -0.4, 0.3), Pose2(5.5, -0.4)
    one = truth.coverage(scanned(two_rooms, [first]), visible)
    both = truth.coverage(scanned(two_rooms, [first, second]), visible)
    corners = [Pose2(x, y) for x in (1.4, 3.7, 4.4, 6.7) for y in (-1.6, 0.6)]
    all_seen = truth.coverage(scanned(two_rooms, [first, second, *corners]), visible)
    assert 0.5 < one < 0.8 < both <= all_seen
    assert all_seen > 0.999


def test_lost_beams_see_nothing(two_rooms):
    assert not scanned(two_rooms, [Pose2(2.5, -0.5)], replace(CLEAN, drop_out=1.0)).any()


def test_a_beam_sees_a_wedge_of_one_degree_up_to_its_end(two_rooms):
    seen = SeenArea(two_rooms)
    seen.add(*(np.array([value]) for value in (1.2, -0.5, 0.0, 2.0)))
    seen.add(*(np.array([value]) for value in (1.2, -0.5, 0.0, 1.0)))  # shorter: nothing new
    cells = np.argwhere(seen.is_seen()) + 0.5
    x, y = two_rooms.metres(cells).T
    assert (np.abs(y + 0.5) <= (x - 1.2) * math.tan(math.radians(0.5)) + 0.05).all()
    assert x.max() == pytest.approx(3.2, abs=0.05)
    assert len(cells) >= 40


def test_map_frame_begins_at_the_start_pose():
    start = Pose2(1.0, 2.0, math.pi / 2)
    world_from_base = np.array([[1.0, 2.0, math.pi / 2], [1.0, 3.0, math.pi]])
    np.testing.assert_allclose(
        truth.in_map_frame(world_from_base, start), [[0, 0, 0], [1, 0, math.pi / 2]], atol=1e-12
    )


def as_map(world, start):
    """The world's own walls as a map in the frame of `start` (turned by quarter turns only)."""
    turns = round(start.heading_rad / (math.pi / 2))
    occupied = np.rot90(world.is_occupied, turns)  # rows grow with y: rot90 turns clockwise
    height, width = world.is_occupied.shape
    corners = world.metres(np.array([[0, 0], [0, width], [height, 0], [height, width]]))
    low = start.inverse().apply(corners).min(axis=0)
    return TernaryMap(
        resolution_m=world.resolution_m,
        origin_m=(float(low[0]), float(low[1])),
        is_occupied=occupied,
        is_free=~occupied,
    )


@pytest.mark.parametrize("heading_rad", [0.0, 0.7, -2.0])
@pytest.mark.parametrize(
    ("point_m", "off_m"),
    [
        ((1.0, 1.62), 0.0),  # on the face of a wall
        ((1.02, 1.62), 0.02),  # before it
        ((0.97, 1.62), 0.03),  # in the wall's first cell
        ((0.5, 1.62), 0.5),  # deep inside the wall
        ((1.53, 1.04), 0.04),  # before another one
        ((0.97, 0.96), 0.05),  # off a corner
    ],
)
def test_wall_error_is_how_far_map_cells_lie_off_the_faces_of_walls(
    heading_rad, point_m, off_m
):
    walls = np.ones((60, 60), dtype=bool)
    walls[20:40, 20:40] = False
    world, start = World(walls, 0.05), Pose2(1.5, 1.5, heading_rad)
    x_m, y_m = start.inverse().apply(np.array([point_m]))[0]
    grid = TernaryMap(
        resolution_m=0.05,
        origin_m=(x_m - 0.025, y_m - 0.025),
        is_occupied=np.ones((1, 1), dtype=bool),
        is_free=np.zeros((1, 1), dtype=bool),
    )
    assert truth.wall_error_m(world, start, grid) == pytest.approx(off_m)


def test_pose_errors_wrap_headings():
    position, heading = truth.pose_errors(
        np.array([[3.0, 4.0, 3.1]]), np.array([[0.0, 0.0, -3.1]])
    )
    assert position[0] == pytest.approx(5.0)
    assert heading[0] == pytest.approx(2 * math.pi - 6.2)


def test_metrics_of_a_run(two_rooms):
    start = Pose2(2.5, -0.5)
    body = RobotBody(two_rooms, start, Config(), np.random.default_rng(0))
    optics = WorldOptics(two_rooms, body, LrfConfig(), CLEAN, np.random.default_rng(1))
    optics.measure(np.zeros(360), TURN)
    true = np.zeros((4, 3))
    estimate = true + np.array([0.03, 0.04, math.radians(1.0)])
    found = truth.metrics(Config(), body, optics, as_map(two_rooms, start), estimate, true)
    assert found["localization_rmse_m"] == pytest.approx(0.05)
    assert found["heading_rmse_deg"] == pytest.approx(1.0)
    assert found["collisions"] == 0
    assert 0.5 < found["coverage"] < 1.0
    assert found["wall_error_m"] == pytest.approx(0.025, abs=1e-3)
