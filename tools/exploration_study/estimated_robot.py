# SPDX-License-Identifier: MIT
"""Exploration on the pure core with the daemon's SLAM in the loop, all noisy."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from exploration_study.sensor_robot import BenchRobot, BenchRun, legs_of
from ins_robot.config import Config
from ins_robot.core.survey import Sector, Survey
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import MotionIncrement, PlannedPath
from ins_robot.navigation.explorer import Drive, Finished
from ins_robot.simulation.world import World

SLIP = 0.02  # standard deviation of the way, share of it
TURN_STD_RAD = math.radians(0.5)  # and of the heading, per metre of way and per turn
LEAST_STD = 1e-3


def explore_estimated(
    world: World, start: Pose2, config: Config, rng: np.random.Generator, mode: str
) -> Iterator[BenchRun]:
    """Scan, locate, map, decide, drive; yields after each decision."""
    robot = BenchRobot(world, start, config.lrf, config.robot.radius_m, rng)
    survey = Survey(config, rng, time.process_time)
    run = BenchRun(robot, survey.grid, survey.explorer)
    motion, stamp_s = _motion(Pose2(), 0.0, 0.0), 0.0
    while not isinstance(run.decision, Finished):
        half_rad = math.pi if run.scans == 0 else math.radians(config.lrf.sector_deg)
        before_ms = survey.ins_ms
        _, run.decision = survey.scan_at_node(
            robot.scan(half_rad, stamp_s), motion, Sector(half_width_rad=half_rad)
        )
        run.decide_ms.append(survey.ins_ms - before_ms)
        run.grid = survey.grid
        run.scans += 1
        robot.look()
        yield run
        if not isinstance(run.decision, Drive):
            break
        legs = legs_of(run.decision.path, mode)
        for leg in legs:
            told = _drive(robot, survey.slam.pose, leg, rng)
            motion = _motion(told, leg.length_m, stamp_s)
            stamp_s += 1.0
            if leg is not legs[-1]:
                survey.scan_on_the_way(robot.scan(math.pi, stamp_s), motion)
                robot.look()


def _drive(
    robot: BenchRobot, believed: Pose2, leg: PlannedPath, rng: np.random.Generator
) -> Pose2:
    """Drive as odometry says; returns what it says, and the robot is somewhere near there."""
    end = Pose2(
        float(leg.points_m[-1, 0]), float(leg.points_m[-1, 1]), float(leg.headings_rad[-1])
    )
    told = believed.inverse() @ end
    true_from_believed = robot.pose @ believed.inverse()
    robot.drive(
        PlannedPath(
            points_m=true_from_believed.apply(leg.points_m),
            headings_rad=leg.headings_rad + true_from_believed.heading_rad,
        )
    )
    x, y, turn = rng.standard_normal(3) * _stds(told, leg.length_m)
    robot.pose = robot.pose @ Pose2(float(x), float(y), float(turn))
    return told


def _stds(told: Pose2, length_m: float) -> np.ndarray:
    way = SLIP * length_m + LEAST_STD
    turn = TURN_STD_RAD * (length_m + abs(told.heading_rad)) + LEAST_STD
    return np.array([way, way, turn])


def _motion(told: Pose2, length_m: float, stamp_s: float) -> MotionIncrement:
    return MotionIncrement(
        from_stamp_s=stamp_s,
        to_stamp_s=stamp_s + 1.0,
        delta=told,
        covariance=np.diag(_stds(told, length_m) ** 2),
    )
