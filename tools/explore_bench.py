#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Exploration on the pure core: perfect pose, ideal scans by ray casting, no wire, no clock.

    python tools/explore_bench.py WORLDS_DIR [--worlds a,b] [--strategies min-gap,...] [--jobs N]

One JSON line per run on stdout, a table on stderr. WORLDS_DIR holds PGM worlds and worlds.csv
(name, start0_x_m, start0_y_m); with reference.jsonl beside it, path lengths are compared.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, label

from ins_robot.config import ExplorationConfig, LrfConfig, MapConfig, RobotConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.ray_cast import cast_rays, cells_on_rays
from ins_robot.messages import LaserScan, PlannedPath
from ins_robot.navigation.explorer import Drive, Explorer, Finished

RESOLUTION_M = 0.05
BEAMS = 360
VIEWPOINT_STEP_M = 0.2
VIEWPOINT_RAYS = 720


@dataclass(frozen=True, slots=True)
class BenchWorld:
    """A world to explore: row 0 at the bottom, metres from the lower left corner."""

    name: str
    is_occupied: np.ndarray
    start: Pose2

    @staticmethod
    def load(folder: Path, name: str, start: int = 0) -> BenchWorld:
        with (folder / "worlds.csv").open() as file:
            row = next(row for row in csv.DictReader(file) if row["name"] == name)
        with Image.open(folder / f"{name}.pgm") as image:
            is_occupied = np.asarray(image)[::-1] <= 200
        pose = Pose2(float(row[f"start{start}_x_m"]), float(row[f"start{start}_y_m"]), 0.0)
        return BenchWorld(name, np.ascontiguousarray(is_occupied), pose)

    def observable(self, radius_m: float, range_m: float) -> np.ndarray:
        """(H, W) bool: free cells in view from where the robot's centre can be."""
        room = distance_transform_edt(~self.is_occupied) * RESOLUTION_M - 0.5 * RESOLUTION_M
        regions, _ = label(room >= radius_m, np.ones((3, 3), int))
        row, col = int(self.start.y_m / RESOLUTION_M), int(self.start.x_m / RESOLUTION_M)
        cells = np.argwhere(regions == regions[row, col])
        step = round(VIEWPOINT_STEP_M / RESOLUTION_M)
        chosen = cells[(cells % step == 0).all(axis=1)]
        seen = np.zeros(self.is_occupied.shape, bool)
        bearings = np.linspace(-math.pi, math.pi, VIEWPOINT_RAYS, endpoint=False)
        for cell in [*chosen, np.array([row, col])]:
            _mark_seen(self.is_occupied, cell + 0.5, bearings, range_m, seen)
        return seen


def _mark_seen(
    is_occupied: np.ndarray, at: np.ndarray, bearings: np.ndarray, range_m: float, seen: np.ndarray
) -> np.ndarray:
    """Mark the cells that rays pass; returns ranges (N,) in metres, inf past the range."""
    reach = range_m / RESOLUTION_M
    distance = cast_rays(is_occupied, at[None], bearings, reach)
    flat, _ = cells_on_rays(is_occupied.shape, at[None], bearings, np.minimum(distance, reach))
    seen.reshape(-1)[flat] = True
    return distance * RESOLUTION_M


class BenchRobot:
    """A robot that is where it wants to be and sees what is there."""

    def __init__(
        self, world: BenchWorld, lrf: LrfConfig, radius_m: float, noise: np.random.Generator | None
    ) -> None:
        self.world, self.lrf, self.radius_m, self.noise = world, lrf, radius_m, noise
        self.pose = Pose2()  # map_from_base; the map begins at the start
        self.seen = np.zeros(world.is_occupied.shape, bool)
        self.path_m = 0.0
        self.clearance_min_m = math.inf
        self.contacts = 0

    def scan(self, half_rad: float) -> LaserScan:
        bearings = np.radians(np.arange(BEAMS) * 360.0 / BEAMS - 180.0)
        bearings = bearings[np.abs(bearings) <= half_rad + 1e-9]
        at = self.world.start @ self.pose
        cell = np.array([at.y_m, at.x_m]) / RESOLUTION_M
        ranges = _mark_seen(
            self.world.is_occupied, cell, bearings + at.heading_rad, self.lrf.range_max_m, self.seen
        )
        ranges = np.where(np.isfinite(ranges), ranges, np.nan)
        std = self.lrf.range_std_floor_m + self.lrf.range_std_per_m2 * ranges**2
        if self.noise is not None:
            ranges = ranges + std * self.noise.standard_normal(len(ranges))
            ranges[self.noise.random(len(ranges)) < 0.03] = np.nan
        std = np.where(np.isfinite(ranges), std, np.nan)
        return LaserScan(
            stamp_s=0.0, bearings_rad=bearings, ranges_m=ranges, range_std_m=std,
            beam_offsets_s=np.zeros(len(bearings)), range_max_m=self.lrf.range_max_m,
        )

    def drive(self, path: PlannedPath) -> None:
        """Teleport along the path, counting contacts (stretches of touching a wall)."""
        pieces = [path.points_m[:1]]
        for a, b in zip(path.points_m[:-1], path.points_m[1:], strict=True):
            count = max(1, math.ceil(math.hypot(*(b - a)) / 0.02))
            pieces.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
        points = np.concatenate(pieces) + [self.world.start.x_m, self.world.start.y_m]
        room = clearance_m(self.world.is_occupied, points)
        touches = room < self.radius_m - 1e-3
        self.contacts += int((touches[1:] & ~touches[:-1]).sum() + touches[0])
        self.clearance_min_m = min(self.clearance_min_m, float(room.min()))
        self.path_m += path.length_m
        x, y = path.points_m[-1]
        self.pose = Pose2(float(x), float(y), float(path.headings_rad[-1]))


def clearance_m(is_occupied: np.ndarray, points_m: np.ndarray, reach: int = 8) -> np.ndarray:
    """(N,) true distance from points to the nearest face of an occupied cell, at most `reach`."""
    at = points_m[:, ::-1] / RESOLUTION_M
    base = np.floor(at).astype(np.int64)
    offsets = np.arange(-reach, reach + 1)
    rows = base[:, 0, None, None] + offsets[:, None]
    cols = base[:, 1, None, None] + offsets[None, :]
    height, width = is_occupied.shape
    inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
    solid = np.ones(np.broadcast_shapes(rows.shape, cols.shape), bool)
    rows, cols = np.broadcast_arrays(rows, cols)
    solid[inside] = is_occupied[rows[inside], cols[inside]]
    down = np.maximum(np.abs(rows + 0.5 - at[:, 0, None, None]) - 0.5, 0.0)
    right = np.maximum(np.abs(cols + 0.5 - at[:, 1, None, None]) - 0.5, 0.0)
    away = np.where(solid, np.hypot(down, right), reach)
    return np.asarray(away.min(axis=(1, 2)) * RESOLUTION_M)


def explore(
    world: BenchWorld,
    config: ExplorationConfig,
    *,
    robot: RobotConfig | None = None,
    lrf: LrfConfig | None = None,
    noise: np.random.Generator | None = None,
    observable: np.ndarray | None = None,
) -> dict[str, object]:
    """One run to its own end."""
    robot, lrf = robot or RobotConfig(), lrf or LrfConfig()
    for _ in (steps := run_steps(world, config, robot, lrf, noise)):
        pass
    del steps
    return {}


@dataclass(slots=True)
class BenchRun:
    """State of a run, readable while it goes."""

    robot: BenchRobot
    grid: OccupancyGrid
    explorer: Explorer
    decision: Drive | Finished | None = None
    scans: int = 0
    marks: list[tuple[float, int]] | None = None
    decide_ms: list[float] | None = None


def run_steps(
    world: BenchWorld,
    config: ExplorationConfig,
    robot: RobotConfig,
    lrf: LrfConfig,
    noise: np.random.Generator | None = None,
) -> Iterator[BenchRun]:
    """Scan, map, decide, drive; yields after each decision, the last is `Finished`."""
    body = BenchRobot(world, lrf, robot.radius_m, noise)
    run = BenchRun(
        body, OccupancyGrid(RESOLUTION_M, MapConfig()), Explorer(config, robot, lrf), decide_ms=[]
    )
    while not isinstance(run.decision, Finished):
        half_rad = math.pi if run.scans == 0 else math.radians(lrf.sector_deg)
        scan = body.scan(half_rad)
        run.grid.integrate(scan, body.pose, lrf.range_trusted_m)
        begun = time.process_time()
        run.explorer.observe(run.scans, float(run.scans), body.pose, scan, (0.0, half_rad))
        run.decision = run.explorer.decide(body.pose, run.grid)
        assert run.decide_ms is not None
        run.decide_ms.append(1e3 * (time.process_time() - begun))
        run.scans += 1
        yield run
        if isinstance(run.decision, Drive):
            body.drive(run.decision.path)


def measure(job: tuple[str, str, str, bool, int, int | None]) -> dict[str, object]:
    """One run of the benchmark as a JSON-able result."""
    folder, name, strategy, guard, start, seed = job
    world = BenchWorld.load(Path(folder), name, start)
    robot, lrf = RobotConfig(), LrfConfig()
    cache = Path("/tmp") / f"observable-{name}-{start}.npy"
    if cache.exists():
        observable = np.load(cache)
    else:
        observable = world.observable(robot.radius_m, lrf.range_max_m)
        np.save(cache, observable)
    config = ExplorationConfig(strategy=strategy, visibility_guard=guard)
    noise = None if seed is None else np.random.default_rng(seed)
    marks: dict[str, float] = {}
    begun = time.perf_counter()
    for run in run_steps(world, config, robot, lrf, noise):  # noqa: B007
        share = (run.robot.seen & observable).sum() / observable.sum()
        for mark in (90, 95, 99):
            if 100.0 * share >= mark:
                marks.setdefault(f"l{mark}_m", round(run.robot.path_m, 2))
        if run.scans > 600:
            break
    assert run.decide_ms is not None
    decision = run.decision
    offset = np.array([world.start.x_m, world.start.y_m])
    centres = (np.argwhere(observable)[:, ::-1] + 0.5) * RESOLUTION_M - offset
    at = run.grid.cells(centres)
    ok = run.grid.contains(at)
    known = np.zeros(len(at), bool)
    known[ok] = ~run.grid.is_unknown[at[ok, 0], at[ok, 1]]
    return {
        "world": name,
        "strategy": strategy,
        "start": start,
        "coverage": round(float(share), 4),
        "known": round(float(known.mean()), 4),
        "path_m": round(run.robot.path_m, 1),
        **{key: marks.get(key) for key in ("l90_m", "l95_m", "l99_m")},
        "scans": run.scans,
        "contacts": run.robot.contacts,
        "clearance_min_m": round(run.robot.clearance_min_m, 3),
        "ms_median": round(float(np.median(run.decide_ms)), 1),
        "ms_max": round(max(run.decide_ms), 1),
        "wall_s": round(time.perf_counter() - begun, 1),
        "end": decision.reason if isinstance(decision, Finished) else "did not end",
        "left": len(decision.left) if isinstance(decision, Finished) else -1,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--worlds", default="")
    parser.add_argument("--strategies", default="min-gap")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--no-guard", action="store_true")
    parser.add_argument("--noise-seed", type=int, default=None)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    names = [row["name"] for row in csv.DictReader((options.folder / "worlds.csv").open())]
    names = options.worlds.split(",") if options.worlds else names
    reference = read_reference(options.folder / "reference.jsonl")
    jobs = [
        (str(options.folder), name, strategy, not options.no_guard, options.start,
         options.noise_seed)
        for strategy in options.strategies.split(",")
        for name in names
    ]
    results = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for result in pool.map(measure, jobs):
            results.append(result)
            print(json.dumps(result), flush=True)
            row = reference.get(str(result["world"]), {})
            print(
                f"{result['world']:24s} {result['strategy']:9s} cov {result['coverage']:.4f} "
                f"known {result['known']:.4f} "
                f"path {result['path_m']:6.1f} l99 {result['l99_m']} "
                f"(nearest {row.get('nearest_recheck', math.nan):.0f}, "
                f"offline {row.get('offline99', math.nan):.0f}) scans {result['scans']:3d} "
                f"contacts {result['contacts']} {result['clearance_min_m']} "
                f"{result['ms_median']}/{result['ms_max']} ms {result['end']} {result['left']}",
                file=sys.stderr,
            )
    summarise(results, reference)


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


def summarise(
    results: list[dict[str, object]], reference: dict[str, dict[str, float]]
) -> None:
    for strategy in dict.fromkeys(str(r["strategy"]) for r in results):
        mine = [r for r in results if r["strategy"] == strategy]
        coverage = np.array([float(str(r["coverage"])) for r in mine])
        ratios = [
            float(str(r["l99_m"] or r["path_m"])) / reference[str(r["world"])]["offline99"]
            for r in mine
            if reference.get(str(r["world"]), {}).get("offline99", 0.0) > 3.0
        ]
        paths = sum(float(str(r["path_m"])) for r in mine)
        scans = sum(int(str(r["scans"])) for r in mine)
        contacts = sum(int(str(r["contacts"])) for r in mine)
        print(
            f"{strategy}: coverage min {coverage.min():.4f} median {np.median(coverage):.4f}; "
            f"path {paths:.0f} m, scans {scans}, contacts {contacts}, "
            f"L99 / offline mean {np.mean(ratios or [math.nan]):.2f} "
            f"worst {max(ratios or [math.nan]):.2f}",
            file=sys.stderr,
        )


if __name__ == "__main__":
    main()
