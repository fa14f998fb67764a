# SPDX-License-Identifier: MIT
"""Helpers of the navigation tests: small worlds in metres, and the bench's perfect robot."""

from dataclasses import replace

import numpy as np
from exploration_study import sensor_robot as bench

from ins_robot.config import Config, ExplorationConfig, LrfConfig, MapConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan
from ins_robot.navigation.gaps import GapRules
from ins_robot.simulation.world import World

RESOLUTION_M = 0.05
RADIUS_M = 0.2
FULL = (0.0, np.pi)
FORWARD = (0.0, np.radians(150.0))


def rules(**changes) -> GapRules:
    values = {
        "gap_range_m": 4.0, "gap_jump_m": 0.5, "range_trusted_m": 3.0, "robot_width_m": 0.4,
    }  # fmt: skip
    return GapRules(**(values | changes))


def plan(
    width_m: float, height_m: float, *rooms, walls=(), resolution_m: float = RESOLUTION_M
) -> World:
    """A world that is solid but for rooms (x0, y0, x1, y1), with wall boxes put back in."""
    shape = (round(height_m / resolution_m), round(width_m / resolution_m))
    is_occupied = np.ones(shape, bool)
    for boxes, value in ((rooms, False), (walls, True)):
        for x0, y0, x1, y1 in boxes:
            rows = slice(round(y0 / resolution_m), round(y1 / resolution_m))
            cols = slice(round(x0 / resolution_m), round(x1 / resolution_m))
            is_occupied[rows, cols] = value
    return World(is_occupied, resolution_m, (0.0, 0.0), name="plan")


def configured(**exploration) -> Config:
    config = Config()
    return replace(config, exploration=replace(config.exploration, **exploration))


def robot_at(world: World, x_m: float, y_m: float, heading_rad: float = 0.0):
    """The perfect robot of the bench, set down here."""
    return bench.BenchRobot(world, Pose2(x_m, y_m, heading_rad), LrfConfig(), RADIUS_M)


def scan_of(ranges_m, bearings_rad) -> LaserScan:
    ranges = np.array(ranges_m, float)
    return LaserScan(
        stamp_s=0.0,
        bearings_rad=np.array(bearings_rad, float),
        ranges_m=ranges,
        range_std_m=np.where(np.isfinite(ranges), 0.01, np.nan),
        beam_offsets_s=np.zeros(len(ranges)),
        range_max_m=6.0,
    )


def grid_of(world: World, is_known=None) -> OccupancyGrid:
    """A grid that knows a whole world (or, of it, the cells of a mask), frame of the world."""
    grid = OccupancyGrid(RESOLUTION_M, MapConfig())
    height, width = world.is_occupied.shape
    odds = np.where(world.is_occupied, 3.0, -3.0)
    if is_known is not None:
        odds = np.where(is_known, odds, 0.0)
    blocks = [-(-n // 64) * 64 for n in (height, width)]
    grid.log_odds, grid.is_quiet = np.zeros(blocks, np.float32), np.zeros(blocks, bool)
    grid.log_odds[:height, :width] = odds
    grid._corner = (
        round(world.origin_m[1] / RESOLUTION_M),
        round(world.origin_m[0] / RESOLUTION_M),
    )
    return grid


def explore(world: World, x_m: float, y_m: float, config: Config | None = None, heading=0.0):
    """A run of the bench to its end."""
    return bench.run_to_end(world, Pose2(x_m, y_m, heading), config or Config())


def exploration(**changes) -> ExplorationConfig:
    return replace(ExplorationConfig(), **changes)
