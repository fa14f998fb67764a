# SPDX-License-Identifier: MIT
"""The guard stops before walls, lets the robot leave them, and never stops a turn."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ins_robot.config import ControlConfig
from ins_robot.control.collision_guard import CollisionGuard
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import VelocityCommand

CONFIG = ControlConfig()
RADIUS_M = 0.2


def _wall_at_x(x_m: float) -> cKDTree:
    """A wall across a 4 m x 4 m map."""
    return cKDTree(np.stack([np.full(401, x_m), np.linspace(0.0, 4.0, 401)], axis=-1))


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


@pytest.mark.parametrize("slant_deg", [10.0, 40.0, 60.0])
def test_what_leads_into_a_wall_at_a_slant_slides_along_it(slant_deg: float) -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(_wall_at_x(2.0))
    pose, slant = Pose2(1.78, 1.0, 0.7), math.radians(slant_deg)
    for _ in range(500):
        vx, vy = Pose2(0.0, 0.0, -pose.heading_rad).apply(
            [[0.1 * math.sin(slant), 0.1 * math.cos(slant)]]
        )[0]
        v, _ = guard.apply(pose, VelocityCommand(vx_mps=vx, vy_mps=vy))
        pose = pose @ Pose2(v.vx_mps * 0.02, v.vy_mps * 0.02, 0.0)
        assert pose.x_m <= 2.0 - RADIUS_M - 0.005
    assert pose.y_m > 1.15


def test_it_slows_down_near_obstacles_whichever_way_it_goes() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(_wall_at_x(2.0))
    far, near = (
        guard.apply(Pose2(x, 2.0, 0.0), VelocityCommand(vy_mps=0.2))[0].vy_mps
        for x in (1.0, 1.7)
    )
    assert far == 0.2
    assert near == pytest.approx((0.1 - 0.0) / CONFIG.guard_time_s, abs=0.04)


def test_a_single_leg_stops_it_and_blocks_the_way_through() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(cKDTree(np.array([[1.3, 2.0]])))
    v, limited = guard.apply(Pose2(1.1, 2.0, 0.0), VelocityCommand(vx_mps=0.2))
    assert limited
    assert v.vx_mps == 0.0
    assert guard.blocks((0.5, 2.0), [(0.9, 2.0), (1.15, 2.0)])
    assert not guard.blocks((0.5, 2.0), [(0.9, 2.0), (1.0, 2.0), (1.3, 2.25)])


def test_a_map_without_obstacles_stops_nobody() -> None:
    guard = CollisionGuard(CONFIG, RADIUS_M)
    guard.observe(cKDTree(np.zeros((0, 2))))
    wanted = VelocityCommand(vx_mps=0.2)
    assert guard.apply(Pose2(2.025, 2.025, 0.0), wanted) == (wanted, False)
