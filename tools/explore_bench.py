#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Exploration on the pure core: perfect pose, scans by ray casting, no wire and no clock.

    python tools/explore_bench.py WORLDS_DIR [--worlds a,b] [--strategies a,b] [--jobs N]

One JSON line per run on stdout, a table on stderr. WORLDS_DIR holds map_server worlds and
worlds.csv with their starts; with reference.jsonl beside it, path lengths are compared.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import math
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ins_robot.config import Config, LrfConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.messages import LaserScan, PlannedPath
from ins_robot.navigation.explorer import Drive, Explorer, Finished
from ins_robot.navigation.planner import dense_points_m
from ins_robot.sensing.range_error import range_std_m
from ins_robot.simulation.seen_area import SeenArea
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

BEAMS = 360
TOUCH_M = 1e-3  # the path's own rounding is no contact
SCANS_MAX = 600
MARKS_PCT = (90, 95, 99)
DROP_OUT = 0.03  # share of beams lost, with --noise-seed
OFFLINE_MIN_M = 3.0  # shorter reference routes give no meaningful ratio


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
        self.contacts = 0
        self.clearance_min_m = math.inf
        self._lrf, self._radius_m, self._noise = lrf, radius_m, noise

    def scan(self, half_width_rad: float) -> LaserScan:
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
            stamp_s=0.0,
            bearings_rad=bearings,
            ranges_m=ranges,
            range_std_m=np.where(np.isfinite(ranges), std, np.nan),
            beam_offsets_s=np.zeros(len(bearings)),
            range_max_m=self._lrf.range_max_m,
        )

    def drive(self, path: PlannedPath) -> None:
        """Go along the path, counting contacts: stretches on which the body is in a wall."""
        points = self.start.apply(dense_points_m(path.points_m, 0.02))
        room = [self.world.clearance.nearest_wall(x, y).distance_m for x, y in points.tolist()]
        touches = np.array(room) < self._radius_m - TOUCH_M
        self.contacts += int(touches[0]) + int((touches[1:] & ~touches[:-1]).sum())
        self.clearance_min_m = min(self.clearance_min_m, *room)
        self.path_m += path.length_m
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
    world: World, start: Pose2, config: Config, noise: np.random.Generator | None = None
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
        yield run
        if isinstance(run.decision, Drive):
            robot.drive(run.decision.path)


def run_to_end(
    world: World, start: Pose2, config: Config, noise: np.random.Generator | None = None
) -> BenchRun:
    """The run after its last decision."""
    *_, run = explore(world, start, config, noise)
    return run


@dataclass(frozen=True, slots=True)
class Job:
    """One run of the benchmark."""

    folder: Path
    name: str
    start: int
    strategy: str
    guard: bool
    noise_seed: int | None

    def measure(self) -> dict[str, object]:
        """Run it; a JSON-able result."""
        config = Config()
        config = dataclasses.replace(
            config,
            exploration=dataclasses.replace(
                config.exploration, strategy=self.strategy, visibility_guard=self.guard
            ),
        )
        world = World.load(self.folder / f"{self.name}.yaml")
        start = read_start(self.folder, self.name, self.start)
        visible = visible_cells(world, start, config.robot.radius_m, config.lrf.range_max_m)
        noise = None if self.noise_seed is None else np.random.default_rng(self.noise_seed)
        marks: dict[str, float] = {}
        begun = time.perf_counter()
        for run in explore(world, start, config, noise):
            share = coverage(run.robot.seen.is_seen(), visible)
            for mark in MARKS_PCT:
                if 100.0 * share >= mark:
                    marks.setdefault(f"l{mark}_m", round(run.robot.path_m, 2))
            if run.scans >= SCANS_MAX:
                break
        ended = run.decision if isinstance(run.decision, Finished) else None
        return {
            "world": self.name,
            "start": self.start,
            "strategy": self.strategy,
            "coverage": round(share, 4),
            "path_m": round(run.robot.path_m, 1),
            **{f"l{mark}_m": marks.get(f"l{mark}_m") for mark in MARKS_PCT},
            "scans": run.scans,
            "contacts": run.robot.contacts,
            "clearance_min_m": round(run.robot.clearance_min_m, 3),
            "ms_median": round(float(np.median(run.decide_ms)), 1),
            "ms_max": round(max(run.decide_ms), 1),
            "wall_s": round(time.perf_counter() - begun, 1),
            "end": ended.reason if ended else f"did not end in {SCANS_MAX} scans",
            "left": len(ended.left) if ended else -1,
        }


def read_names(folder: Path) -> list[str]:
    with (folder / "worlds.csv").open() as file:
        return [row["name"] for row in csv.DictReader(file)]


def read_start(folder: Path, name: str, start: int) -> Pose2:
    with (folder / "worlds.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if row["name"] == name)
    return Pose2(float(row[f"start{start}_x_m"]), float(row[f"start{start}_y_m"]), 0.0)


def read_reference(path: Path) -> dict[str, dict[str, float]]:
    """Path length to 99 % (own end where it was missed) by world and algorithm, stop mode."""
    table: dict[str, dict[str, float]] = {}
    if not path.exists():
        return table
    for line in path.read_text().splitlines():
        row = json.loads(line)
        if row["mode"] == "stop":
            table.setdefault(row["map"], {})[row["alg"]] = row["L99"] or row["full"]
    return table


def line_of(result: dict[str, object], reference: dict[str, float]) -> str:
    nearest = reference.get("nearest_recheck", math.nan)
    offline = reference.get("offline99", math.nan)
    return (
        "{world:24s} {strategy:9s} coverage {coverage:.4f} path {path_m:6.1f} m, "
        "to 99 % {l99_m} m (nearest {nearest:.0f}, offline {offline:.0f}) scans {scans:3d} "
        "contacts {contacts} ({clearance_min_m} m) {ms_median}/{ms_max} ms, {end}, {left} left"
    ).format(**result, nearest=nearest, offline=offline)


def summary_of(results: list[dict], reference: dict[str, dict[str, float]]) -> str:
    shares = np.array([r["coverage"] for r in results])
    ratios = [
        (r["l99_m"] or r["path_m"]) / offline
        for r in results
        if (offline := reference.get(r["world"], {}).get("offline99", 0.0)) > OFFLINE_MIN_M
    ] or [math.nan]
    return (
        f"{results[0]['strategy']}: {len(results)} runs, coverage min {shares.min():.4f} "
        f"median {np.median(shares):.4f}, path {sum(r['path_m'] for r in results):.0f} m, "
        f"scans {sum(r['scans'] for r in results)}, "
        f"contacts {sum(r['contacts'] for r in results)}, "
        f"path to 99 % / offline mean {np.mean(ratios):.2f} worst {max(ratios):.2f}, "
        f"decision median {np.median([r['ms_median'] for r in results]):.0f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--worlds", default="", help="names, by comma; default all")
    parser.add_argument("--strategies", default="min-gap")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--no-guard", action="store_true", help="the paper's rules as printed")
    parser.add_argument("--noise-seed", type=int, help="range noise and lost beams")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    names = options.worlds.split(",") if options.worlds else read_names(options.folder)
    strategies = options.strategies.split(",")
    reference = read_reference(options.folder / "reference.jsonl")
    jobs = [
        Job(options.folder, n, options.start, s, not options.no_guard, options.noise_seed)
        for s in strategies
        for n in names
    ]
    results: list[dict] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(Job.measure, jobs):
            results.append(result)
            print(json.dumps(result), flush=True)
            print(line_of(result, reference.get(str(result["world"]), {})), file=sys.stderr)
    for strategy in strategies:
        mine = [r for r in results if r["strategy"] == strategy]
        print(summary_of(mine, reference), file=sys.stderr)


if __name__ == "__main__":
    main()
