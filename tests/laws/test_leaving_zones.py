# SPDX-License-Identifier: MIT
"""A zone laid over the robot: planner and guard let it out, and then keep it out."""

import math

import numpy as np
import pytest
from changing_world import tell
from exploring import RADIUS_M, configured, plan
from scipy.spatial import cKDTree

from ins_robot.config import ControlConfig
from ins_robot.control.collision_guard import CollisionGuard
from ins_robot.control.path_follower import Following, PathFollower
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.navigation.bounds import Bounds

TICK_S = 0.02
ROOM = plan(10, 8, (0.5, 0.5, 9.5, 7.5))
START = Pose2(3.0, 4.0, 0.0)
PLACE_M = np.array([2.2, 1.0])


def square(half_m: float, x_m: float = 0.0) -> Zone:
    a, b = x_m - half_m, x_m + half_m
    corners = ((a, -half_m), (b, -half_m), (b, half_m), (a, half_m))
    return Zone(name="here", kind=ZoneKind.NO_GO, points_m=corners)


def wall(x_m: float) -> Zone:
    return Zone(name="here", kind=ZoneKind.WALL, points_m=((x_m, -1.0), (x_m, 1.0)))


def follow(path, walls: cKDTree) -> tuple[Following, Pose2]:
    """What the robot does that the guard lets do, exactly."""
    config, pose = ControlConfig(), Pose2()
    guard, follower = CollisionGuard(config, RADIUS_M), PathFollower(path, config)
    guard.observe(walls)
    while follower.verdict is Following.ON_THE_WAY:
        velocity, _ = guard.apply(pose, follower.step(pose, TICK_S))
        x, y = velocity.vx_mps * TICK_S, velocity.vy_mps * TICK_S
        pose = pose @ Pose2(x, y, velocity.yaw_rate_radps * TICK_S)
    return follower.verdict, pose


@pytest.mark.parametrize(
    "zone",
    [
        square(0.15),
        square(0.5),
        square(1.5),
        square(0.5, 0.45),  # the robot stands near its edge, inside
        square(0.5, 0.65),  # and outside, the line under its body
        wall(0.0),
        wall(0.02),
        wall(-0.02),
        wall(0.15),
    ],
    ids=["small", "around", "deep", "inside", "outside", "on", "before", "behind", "beside"],
)
def test_a_zone_laid_over_the_robot_lets_it_out(zone):
    story = tell(ROOM, START, configured(max_scans=1, return_home=False))
    explorer = story.explorer
    explorer.forbid((zone,))
    drive = explorer.send_to(PLACE_M, Pose2(), story.grid)
    points = np.concatenate([story.grid.walls().data, explorer.bounds.fence_m(Pose2())])
    verdict, pose = follow(drive.path, cKDTree(points))
    assert verdict is Following.ARRIVED
    assert math.hypot(pose.x_m - PLACE_M[0], pose.y_m - PLACE_M[1]) < 0.1


def test_out_of_it_the_whole_line_stands_and_far_from_it_all_the_time():
    far = Zone(name="far", kind=ZoneKind.NO_GO, points_m=((3, 1), (4, 1), (4, 2)))
    config = configured().exploration
    both = Bounds(config, RADIUS_M, (square(0.5), far))
    outside, inside = both.fence_m(Pose2(2.0, 0.0, 0.0)), both.fence_m(Pose2(0.45, 0.0, 0.0))
    np.testing.assert_array_equal(outside, both.fence_m(Pose2(0.0, 2.0, 0.0)))
    is_far = np.array([any((point == other).all() for other in inside) for point in outside])
    away = np.hypot(*(outside - (0.45, 0.0)).T)
    assert is_far[outside[:, 0] > 1.0].all()
    assert not is_far[away < 0.5].any()
    assert is_far[away > 1.0].all()
