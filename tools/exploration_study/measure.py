# SPDX-License-Identifier: MIT
"""One run of the benchmark, from its start to its own stop."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from exploration_study.estimated_robot import explore_estimated
from exploration_study.reference_explorer import GapsOnReferenceGrid
from exploration_study.reference_grid import load_reference_grid
from exploration_study.reference_robot import ReferenceRobot
from exploration_study.sensor_robot import BenchRun, explore
from exploration_study.track import Pace, Track
from ins_robot.config import Config, load
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.explorer import Finished
from ins_robot.navigation.planner import plan
from ins_robot.navigation.strategies import PLACE_CHOOSERS
from ins_robot.navigation.terrain import BodyRules, driven_cells, survey_terrain
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

SCANS_MAX = 600
COMPLETE = 0.99
SPIN_UP_S = 1.5  # from motor-on to a steady revolution


def measure_reference(
    path: Path, start_m: tuple[float, float], strategy: str, mode: str
) -> Track:
    """Under the conditions of the published baselines; ends at 99 %."""
    grid = load_reference_grid(path, *start_m)
    if strategy in PLACE_CHOOSERS:
        robot = ReferenceRobot(grid, PLACE_CHOOSERS[strategy](), mode)
    else:
        robot = ReferenceRobot(grid, GapsOnReferenceGrid(strategy, grid), mode)
    for _ in robot.explore():
        pass
    return robot.track


def measure_sensor(
    path: Path,
    start_m: tuple[float, float],
    strategy: str,
    mode: str,
    pose: str,
    seed: int,
    overrides: tuple[str, ...],
) -> Track:
    """With the sensor and body of the configuration, to the robot's own stop."""
    config = configured(load(None, list(overrides)), strategy)
    world = World.load(path)
    start = Pose2(*start_m, 0.0)
    visible = visible_cells(world, start, config.robot.radius_m, config.lrf.range_max_m)
    revolutions_s = config.lrf.revolutions * 60.0 / config.lrf.rpm
    track = Track(
        Pace(speed_mps=config.control.cruise_mps, scan_s=SPIN_UP_S + revolutions_s)
        if mode == "stop"
        else Pace(speed_mps=config.control.cruise_mps, scan_s=revolutions_s)
    )
    rng = np.random.default_rng(seed)
    runs = (
        explore_estimated(world, start, config, rng, mode)
        if pose == "estimated"
        else explore(world, start, config, mode=mode)
    )
    for run in runs:
        track.path_m, track.stops = run.robot.path_m, run.scans
        track.turning_rad = run.robot.turning_rad
        track.decide_ms = run.decide_ms
        track.contacts = run.robot.contacts
        track.clearance_min_m = run.robot.clearance_min_m
        for path_m, is_seen in run.robot.looks:
            track.path_m = path_m
            track.saw(coverage(is_seen, visible))
        run.robot.looks.clear()
        track.path_m = run.robot.path_m
        if run.scans >= SCANS_MAX:
            break
    ended = run.decision if isinstance(run.decision, Finished) else None
    track.end = ended.reason if ended else f"did not end in {SCANS_MAX} scans"
    track.home_m = _home_m(run)
    if math.isinf(track.clearance_min_m or math.inf):
        track.clearance_min_m = None
    if track.coverage < COMPLETE:
        track.failure = f"{track.coverage:.4f} seen: {track.end}"
    elif track.contacts:
        track.failure = f"{track.contacts} contacts"
    elif ended is None:
        track.failure = track.end
    return track


def configured(config: Config, strategy: str) -> Config:
    """The configuration with another strategy; the way home is measured, not driven."""
    exploration = dataclasses.replace(config.exploration, strategy=strategy, return_home=False)
    return dataclasses.replace(config, exploration=exploration)


def _home_m(run: BenchRun) -> float | None:
    """Length of the cheapest way back to the start on the map; None where it knows none."""
    body = BodyRules(radius_m=run.robot.radius_m, clearance_m=0.0)
    odd = driven_cells(run.grid, run.explorer.graph.driven_m(), body)
    terrain = survey_terrain(run.grid, run.robot.pose, body, odd=odd)
    row, col = (int(v) for v in run.grid.cells(np.zeros(2)))
    if not np.isfinite(terrain.cost_m[row, col]):
        return None
    return plan(terrain, run.robot.pose, (row, col), 0.0).length_m
