# SPDX-License-Identifier: MIT
"""The guard stops before walls, lets the robot leave them, and never stops a turn."""

import math

import numpy as np
import pytest

from ins_robot.config import ControlConfig
from ins_robot.control.collision_guard import CollisionGuard, Surroundings
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import VelocityCommand

CONFIG = ControlConfig()
RADIUS_M = 0.2


def _wall_at_x(x_m: float) -> Surroundings:
    """Known distances in a 4 m x 4 m map whose wall is everything beyond `x_m`."""
    centres = (np.arange(80) + 0.5) * 0.05
    distance = np.maximum(0.0, x_m + 0.025 - centres)
    return Surroundings(np.tile(distance, (80, 1)), (0.0, 0.0), 0.05)


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
def test_a_base_driven_at_a_wall_stops_short_of_it(heading: float) -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(_wall_at_x(2.0))
    pose = Pose2(1.0, 2.0, heading)
    vx, vy = 0.3 * math.cos(heading), -0.3 * math.sin(heading)  # towards +x of the map
    for _ in range(2000):
        v, _ = guard.apply(pose, VelocityCommand(vx_mps=vx, vy_mps=vy))
        pose = pose @ Pose2(v.vx_mps * 0.02, v.vy_mps * 0.02, 0.0)
    assert 1.6 < pose.x_m <= 2.0 - RADIUS_M


def test_it_may_leave_a_wall_it_is_too_near_to() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(_wall_at_x(2.0))
    near = Pose2(1.9, 2.0, 0.0)
    away, limited = guard.apply(near, VelocityCommand(vx_mps=-0.2))
    assert away.vx_mps < -0.05  # at a crawl, but away
    assert not limited
    towards, limited = guard.apply(near, VelocityCommand(vx_mps=0.2, yaw_rate_radps=0.5))
    assert (towards.vx_mps, towards.yaw_rate_radps, limited) == (0.0, 0.5, True)


def test_it_slows_down_near_obstacles_whichever_way_it_goes() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(_wall_at_x(2.0))
    far, near = (
        guard.apply(Pose2(x, 2.0, 0.0), VelocityCommand(vy_mps=0.2))[0].vy_mps
        for x in (1.0, 1.7)
    )
    assert far == 0.2
    assert near == pytest.approx((0.1 - 0.0) / CONFIG.guard_time_s, abs=0.04)


def test_a_live_point_stops_it_where_the_map_is_free() -> None:
    known = _wall_at_x(9.0)
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(Surroundings(known.distance_m, known.origin_m, 0.05, np.array([[1.3, 2.0]])))
    v, limited = guard.apply(Pose2(1.1, 2.0, 0.0), VelocityCommand(vx_mps=0.2))
    assert limited
    assert v.vx_mps == 0.0


def test_a_map_without_obstacles_stops_nobody() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(Surroundings(np.full((80, 80), np.inf), (0.0, 0.0), 0.05))
    wanted = VelocityCommand(vx_mps=0.2)
    assert guard.apply(Pose2(2.025, 2.025, 0.0), wanted) == (wanted, False)
