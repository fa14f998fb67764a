# SPDX-License-Identifier: MIT
"""An ideal base follows any path within limits; a blocked one says so."""

import math

import numpy as np
import pytest

from ins_robot.config import ControlConfig
from ins_robot.control.limits import VelocityLimits
from ins_robot.control.path_follower import Following, PathFollower
from ins_robot.control.reference import ReferenceTrajectory
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath

CONFIG = ControlConfig()
DT_S = 0.02
PATHS = {
    "straight": ([[0, 0], [1, 0]], [0, 0]),
    "corner": ([[0, 0], [1, 0], [1, 1]], [0, 0, math.pi / 2]),
    "u-turn": ([[0, 0], [1, 0], [0, 0.05]], [0, 0, math.pi]),
    "on the spot": ([[0, 0], [0, 0]], [0, 3.0]),
    "already there": ([[0, 0]], [0]),
    "sideways": ([[0, 0], [0, 2]], [0, 0]),
}


def _path(name: str) -> PlannedPath:
    points, headings = PATHS[name]
    return PlannedPath(points_m=np.array(points, float), headings_rad=np.array(headings, float))


def _drive(path: PlannedPath, seconds: float = 60.0, blocked: bool = False):
    follower, limits = PathFollower(path, CONFIG), VelocityLimits(CONFIG)
    pose, poses, commands = Pose2(0, 0, float(path.headings_rad[0])), [], []
    for _ in range(int(seconds / DT_S)):
        command, _ = limits.apply(follower.step(pose, DT_S), DT_S)
        if follower.verdict is not Following.ON_THE_WAY:
            break
        if not blocked:
            pose = pose @ Pose2(
                command.vx_mps * DT_S, command.vy_mps * DT_S, command.yaw_rate_radps * DT_S
            )
        poses.append(pose)
        commands.append(command)
    return follower, poses, commands


@pytest.mark.parametrize("name", PATHS)
def test_an_ideal_base_arrives_within_tolerance_and_about_on_time(name: str) -> None:
    path = _path(name)
    follower, poses, _ = _drive(path)
    assert follower.verdict is Following.ARRIVED
    end = poses[-1] if poses else Pose2()
    assert math.dist((end.x_m, end.y_m), path.points_m[-1]) <= CONFIG.position_tolerance_m
    assert len(poses) * DT_S <= follower.duration_s + 2.0


@pytest.mark.parametrize("name", PATHS)
def test_the_way_driven_stays_near_the_path(name: str) -> None:
    path = _path(name)
    _, poses, _ = _drive(path)
    for pose in poses:
        here = np.array([pose.x_m, pose.y_m])
        offs = []
        for a, b in zip(path.points_m[:-1], path.points_m[1:], strict=True):
            u = np.clip((here - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
            offs.append(np.hypot(*(here - a - u * (b - a))))
        assert min(offs, default=0.0) < 0.035


@pytest.mark.parametrize("name", PATHS)
def test_the_reference_keeps_the_limits_and_starts_and_ends_at_rest(name: str) -> None:
    reference = ReferenceTrajectory(_path(name), CONFIG)
    times = np.arange(0.0, reference.duration_s, 0.005)
    states = [reference.at(float(t)) for t in times]
    speeds = np.array([math.hypot(s.vx_mps, s.vy_mps) for s in states])
    assert (speeds <= CONFIG.cruise_mps + 1e-9).all()
    assert all(abs(s.yaw_rate_radps) <= CONFIG.turn_radps for s in states)
    end = reference.at(reference.duration_s + 1.0)
    assert (end.vx_mps, end.vy_mps, end.yaw_rate_radps) == (0.0, 0.0, 0.0)


def test_acceleration_is_limited() -> None:
    _, _, commands = _drive(_path("u-turn"))
    v = np.array([[c.vx_mps, c.vy_mps] for c in commands])
    assert np.abs(np.diff([c.yaw_rate_radps for c in commands])).max() <= (
        CONFIG.yaw_accel_radps2 * DT_S + 1e-9
    )
    assert np.hypot(*np.diff(v, axis=0).T).max() <= 2.5 * CONFIG.accel_mps2 * DT_S + 1e-9


def test_a_robot_that_is_held_is_stuck_and_its_reference_waits() -> None:
    follower, _, _ = _drive(_path("straight"), blocked=True)
    assert follower.verdict is Following.STUCK
