# SPDX-License-Identifier: MIT
"""Lambda over a run tells a wrong wheel radius, and says so in one sentence."""

from __future__ import annotations

import numpy as np
import pytest
from ray_world import ROOM, along_way_points, drive, motion_between

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.slam import Slam
from ins_robot.estimation.wheel_scale import WheelScale, WheelScaleMeter
from ins_robot.geometry.pose2 import Pose2

TOUR = [(0, 0), (3, 0), (3, 2), (0.5, 2), (0, 0)]
STEP, JUMP = np.array([0.5, 0.0, 0.0]), np.array([0.0, 3.0, 0.0])
PATH = along_way_points(TOUR * 3, 0.5)


def slam_after(estimator, scale, **more):
    config = SlamConfig(estimator=estimator)
    slam = Slam(config, MapConfig(), Pose2(), np.random.default_rng(0))
    motion = {"scale": scale, "std": (0.01, 0.01, 0.01)}
    drive(slam, ROOM, PATH, 5, motion=motion, **more)
    return slam


@pytest.mark.parametrize("estimator", ["similarity", "fastslam", "particle"])
@pytest.mark.parametrize("scale", [1.05, 1.0, 0.95])
def test_a_wrong_wheel_radius_is_found(estimator, scale):
    """Wheels taken 5 % too large make ways 5 % too long."""
    found = slam_after(estimator, scale).wheel_scale
    assert found.std < 0.01
    assert found.scale == pytest.approx(1.0 / scale, abs=max(3.0 * found.std, 0.01))
    assert found.is_off == (scale != 1.0)


def test_the_advice_names_the_option_and_the_factor():
    notes = slam_after("similarity", 1.05).notes()
    factor = f"{notes['wheel_scale']:.3f}"
    assert notes["wheel_scale_advice"].endswith(f"multiply wheels.radius_m by {factor}")
    assert "longer than the scans" in notes["wheel_scale_advice"]
    assert "multiply" not in WheelScale(scale=1.004, std=0.001).advice
    assert "multiply" not in WheelScale(scale=1.05, std=0.03).advice
    assert "shorter than the scans" in WheelScale(scale=1.05, std=0.005).advice


def test_odometry_alone_and_short_runs_say_nothing():
    assert slam_after("odometry", 1.05).wheel_scale is None
    assert slam_after("odometry", 1.05).notes() == {}
    assert WheelScaleMeter().value() is None


def test_a_jump_of_the_map_is_no_scale():
    rng = np.random.default_rng(1)
    meter = WheelScaleMeter()
    pose = np.zeros(3)
    for step in range(60):
        meter.moved(motion_between((0, 0, 0), (0.5, 0.0, 0.0)))
        pose = pose + STEP + rng.normal(0.0, 0.005, 3) * (1, 1, 0)
        if step % 7 == 6:
            pose = pose + JUMP
            meter.interrupt()
        meter.located(pose)
    assert meter.value() is None  # no stretch was ever whole

    for step in range(60):
        meter.moved(motion_between((0, 0, 0), (0.5, 0.0, 0.0)))
        pose = pose + STEP
        if step % 15 == 14:
            pose = pose + JUMP
            meter.interrupt()
        meter.located(pose)
    assert meter.value().scale == pytest.approx(1.0, abs=0.003)
