# SPDX-License-Identifier: MIT
"""Exploration on the pure core with the configured sensor: perfect pose, no wire, no clock."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import Config, LrfConfig
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.messages import LaserScan, PlannedPath
from ins_robot.navigation.explorer import Drive, Explorer, Finished
from ins_robot.navigation.planner import dense_points_m
from ins_robot.sensing.range_error import range_std_m
from ins_robot.simulation.seen_area import SeenArea
from ins_robot.simulation.world import World

BEAMS = 360
TOUCH_M = 1e-3  # the path's own rounding is no contact
SCAN_EVERY_M = 0.2  # enroute
STEP_M = 0.02
DROP_OUT = 0.03  # share of beams lost, with noise


class BenchRobot:
    """A robot that is where it wants to be and sees what is there."""

    def __init__(
        self,
        world: World,
        start: Pose2,
        lrf: LrfConfig,
        radius_m: float,
        noise: np.random.Generator | None = None,
    ) -> None:
        self.world, self.start = world, start
        self.pose = Pose2()  # map_from_base; the map begins at the start
        self.seen = SeenArea(world)
        self.path_m = 0.0
        self.turning_rad = 0.0
        self.contacts = 0
        self.clearance_min_m = math.inf
        self.looks: list[tuple[float, NDArray[np.bool_]]] = []
        self._lrf, self.radius_m, self._noise = lrf, radius_m, noise

    def scan(self, half_width_rad: float, stamp_s: float = 0.0) -> LaserScan:
        """What the LRF reads here; silent beyond its range."""
        bearings = np.radians(np.arange(BEAMS) * (360.0 / BEAMS) - 180.0)
        bearings = bearings[np.abs(bearings) <= half_width_rad + 1e-9]
        at = self.start @ self.pose
        cell = self.world.cells(np.array([[at.x_m, at.y_m]]))
        reach = self._lrf.range_max_m / self.world.resolution_m
        ranges = cast_rays(self.world.is_occupied, cell, bearings + at.heading_rad, reach)
        ranges = ranges * self.world.resolution_m
        self.seen.add(
            np.full(len(bearings), at.x_m),
            np.full(len(bearings), at.y_m),
            bearings + at.heading_rad,
            np.minimum(ranges, self._lrf.range_max_m),
        )
        ranges[~np.isfinite(ranges)] = np.nan
        std = range_std_m(ranges, self._lrf.range_std_floor_m, self._lrf.range_std_per_m3)
        if self._noise is not None:
            ranges = ranges + std * self._noise.standard_normal(len(ranges))
            ranges[self._noise.random(len(ranges)) < DROP_OUT] = np.nan
        return LaserScan(
            stamp_s=stamp_s,
            bearings_rad=bearings,
            ranges_m=ranges,
            range_std_m=np.where(np.isfinite(ranges), std, np.nan),
            beam_offsets_s=np.zeros(len(bearings)),
            range_max_m=self._lrf.range_max_m,
        )

    def look(self) -> None:
        """Note what has been seen up to here."""
        self.looks.append((self.path_m, self.seen.is_seen()))

    def drive(self, path: PlannedPath) -> None:
        """Go along the path, counting contacts: stretches on which the body is in a wall."""
        points = self.start.apply(dense_points_m(path.points_m, 0.02))
        room = [self.world.clearance.nearest_wall(x, y).distance_m for x, y in points.tolist()]
        touches = np.array(room) < self.radius_m - TOUCH_M
        self.contacts += int(touches[0]) + int((touches[1:] & ~touches[:-1]).sum())
        self.clearance_min_m = min(self.clearance_min_m, *room)
        self.path_m += path.length_m
        self.turning_rad += float(np.abs(wrap_rad(np.diff(path.headings_rad))).sum())
        x, y = path.points_m[-1]
        self.pose = Pose2(float(x), float(y), float(path.headings_rad[-1]))


@dataclass(slots=True)
class BenchRun:
    """A run, readable while it goes."""

    robot: BenchRobot
    grid: OccupancyGrid
    explorer: Explorer
    decision: Drive | Finished | None = None
    scans: int = 0
    decide_ms: list[float] = field(default_factory=list)


def explore(
    world: World,
    start: Pose2,
    config: Config,
    noise: np.random.Generator | None = None,
    mode: str = "stop",
) -> Iterator[BenchRun]:
    """Scan, map, decide, drive; yields after each decision, the last one is `Finished`."""
    robot = BenchRobot(world, start, config.lrf, config.robot.radius_m, noise)
    run = BenchRun(
        robot,
        OccupancyGrid(config.map.resolution_m, config.map),
        Explorer(config.exploration, config.robot, config.lrf),
    )
    while not isinstance(run.decision, Finished):
        half_rad = math.pi if run.scans == 0 else math.radians(config.lrf.sector_deg)
        scan = robot.scan(half_rad)
        run.grid.integrate(scan, robot.pose, config.lrf.range_trusted_m)
        begun = time.process_time()
        run.explorer.observe(run.scans, float(run.scans), robot.pose, scan, (0.0, half_rad))
        run.decision = run.explorer.decide(robot.pose, run.grid)
        run.decide_ms.append(1e3 * (time.process_time() - begun))
        run.scans += 1
        robot.look()
        yield run
        if isinstance(run.decision, Drive):
            *sweeps, last = legs_of(run.decision.path, mode)
            for leg in sweeps:
                robot.drive(leg)
                sweep = robot.scan(math.pi)
                run.grid.integrate(sweep, robot.pose, config.lrf.range_trusted_m)
                robot.look()
            robot.drive(last)


def run_to_end(
    world: World, start: Pose2, config: Config, noise: np.random.Generator | None = None
) -> BenchRun:
    """The run after its last decision."""
    *_, run = explore(world, start, config, noise)
    return run


def legs_of(path: PlannedPath, mode: str) -> list[PlannedPath]:
    """The whole path, or, `enroute`, the stretches after which the robot looks."""
    if mode == "stop" or path.length_m < 2.0 * SCAN_EVERY_M:
        return [path]
    points = dense_points_m(path.points_m, STEP_M)
    along, known = _along(points), _along(path.points_m)
    headings = wrap_rad(np.interp(along, known, np.unwrap(path.headings_rad)))
    wanted = np.arange(1, int(along[-1] / SCAN_EVERY_M)) * SCAN_EVERY_M
    edges = [0, *np.searchsorted(along, wanted).tolist(), len(points) - 1]
    return [
        PlannedPath(points_m=points[a : b + 1], headings_rad=headings[a : b + 1])
        for a, b in pairwise(edges)
    ]


def _along(points_m: FloatArray) -> FloatArray:
    steps = np.hypot(*np.diff(points_m, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])
