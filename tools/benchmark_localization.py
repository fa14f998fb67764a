# SPDX-License-Identifier: MIT
"""Where am I, from nothing: right, ambiguous, lost, or wrong, over many worlds and places.

    python tools/benchmark_localization.py --worlds ../shared/data/worlds   # ten of them
    python tools/benchmark_localization.py                                  # the shipped ones
    ... --places 20 --scans 10 --revolutions 1 --only office house_c4c55620

Scans come from the simulator's optics (noise and lost beams of an XV-11), several revolutions
combined as the robot does it; between them the robot drives a random straight way, and its
odometry errs. The map is the world's own: faces of walls, free cells, the rest unknown.
Places are uniform over where the body can be, any heading. "wrong" is
located elsewhere than within 0.1 m and 3 deg. Symmetrical worlds (made here) are apart, and so
is each robot with the map of another world, where "located" is wrong by definition.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy import ndimage

from ins_robot.config import Config, LrfConfig, SimulationConfig
from ins_robot.estimation.global_localization import Ambiguous, GlobalLocalizer, Located
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import TernaryMap
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.messages import LaserScan, MotionIncrement
from ins_robot.sensing.range_error import range_std_m
from ins_robot.sensing.scan_filter import combine
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.shipped_worlds import shipped_worlds
from ins_robot.simulation.world import World

RIGHT_M, RIGHT_RAD = 0.1, math.radians(3.0)
BEAMS = 360
STEP_MIN_M, STEP_MAX_M = 0.4, 1.2
SLIP_STD = np.array([0.03, 0.02])  # per metre along and across
TURN_STD_PER_RAD, TURN_STD_PER_M = 0.03, 0.02
FLOOR_STD = np.array([0.003, 0.003, 0.003])
RESOLUTION_M = 0.05
FOREIGN_SCANS = 5  # each is tried everywhere, and more make nothing fit better


class Placed:
    """A body that stands where it is put; what the optics ask of one."""

    def __init__(self) -> None:
        self.pose = Pose2()

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        return np.tile(self.pose.as_array(), (len(stamps_s), 1))


class Eye:
    """The LRF in one world."""

    def __init__(self, world: World, rng: np.random.Generator, revolutions: int) -> None:
        self._lrf, self._body, self._revolutions = LrfConfig(), Placed(), revolutions
        simulation = SimulationConfig()
        self._optics = WorldOptics(world, self._body, self._lrf, simulation, rng)  # type: ignore[arg-type]
        self._bearings_rad = np.radians(np.arange(BEAMS) * 360.0 / BEAMS) - math.pi

    def scan(self, world_from_base: Pose2) -> LaserScan:
        self._body.pose = world_from_base
        return combine([self._revolution() for _ in range(self._revolutions)], self._lrf)

    def _revolution(self) -> LaserScan:
        ranges_m = self._optics.measure(np.zeros(BEAMS), self._bearings_rad).range_m
        limits = (self._lrf.range_min_m, self._lrf.range_max_m)
        ranges_m = np.where((ranges_m >= limits[0]) & (ranges_m <= limits[1]), ranges_m, np.nan)
        std_m = range_std_m(ranges_m, self._lrf.range_std_floor_m, self._lrf.range_std_per_m3)
        return LaserScan(
            stamp_s=0.0,
            bearings_rad=self._bearings_rad.copy(),
            ranges_m=ranges_m,
            range_std_m=std_m,
            beam_offsets_s=np.zeros(BEAMS),
            range_max_m=self._lrf.range_max_m,
        )


@dataclass
class Tally:
    name: str
    places: int = 0
    right: int = 0
    wrong: int = 0
    ambiguous: int = 0
    truth_among_rivals: int = 0
    lost: int = 0
    scans: list[int] = field(default_factory=list)
    errors_m: list[float] = field(default_factory=list)
    errors_deg: list[float] = field(default_factory=list)
    step_ms: list[float] = field(default_factory=list)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=Path, help="directory of worlds with worlds.csv")
    parser.add_argument("--count", type=int, default=10, help="of these, evenly by size")
    parser.add_argument("--only", nargs="*", default=[], help="names of worlds")
    parser.add_argument("--places", type=int, default=20)
    parser.add_argument("--foreign-places", type=int, default=10)
    parser.add_argument("--scans", type=int, default=10)
    parser.add_argument("--revolutions", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    worlds = find_worlds(args)
    plain = [measure(world, world, args) for world in worlds]
    print(f"{args.places} places a world, at most {args.scans} scans each\n")
    print(table(plain, "all"), flush=True)
    symmetrical = [measure(world, world, args) for world in symmetrical_worlds()]
    print("\nsymmetrical worlds:\n", flush=True)
    print(table(symmetrical, "all"))
    others = worlds[1:] + worlds[:1]
    args.places, args.scans = args.foreign_places, min(args.scans, FOREIGN_SCANS)
    foreign = [measure(world, other, args) for world, other in zip(worlds, others, strict=True)]
    print("\nwith the map of another world:\n")
    print(table(foreign, "all"))
    wrong = sum(tally.wrong for tally in [*plain, *symmetrical, *foreign])
    right = sum(tally.right for tally in plain) / max(1, sum(tally.places for tally in plain))
    print(f"\nright {100.0 * right:.1f} % (bar 95), confidently wrong {wrong} (bar 0)")
    return 0 if right >= 0.95 and not wrong else 1


def find_worlds(args: argparse.Namespace) -> list[World]:
    if args.worlds is None:
        names = args.only or shipped_worlds()
        return [World.builtin(name) for name in names]
    with (args.worlds / "worlds.csv").open() as file:
        rows = sorted(csv.DictReader(file), key=lambda row: float(row["free_m2"]))
    names = [row["name"] for row in rows]
    if args.only:
        names = [name for name in names if name in args.only]
    else:
        chosen = np.unique(np.linspace(0, len(names) - 1, args.count).round().astype(int))
        names = [names[k] for k in chosen]
    return [World.load(args.worlds / f"{name}.yaml") for name in names]


def symmetrical_worlds() -> list[World]:
    """A hall (turned by 180 deg it is itself), twin rooms, and a ring with four equal sides."""
    hall = drawn(8.0, 5.0)
    twins = drawn(10.4, 4.0)
    twins[:, box_cells(5.0, 5.4)] = True
    twins[box_cells(1.6, 2.4), box_cells(5.0, 5.4)] = False
    for x in (0.5, 10.4 - 0.5 - 0.6):  # a cupboard each, point symmetrical
        y = 0.2 if x < 1.0 else 4.0 - 0.2 - 0.8
        twins[box_cells(y, y + 0.8), box_cells(x, x + 0.6)] = True
    ring = drawn(7.0, 7.0)
    ring[box_cells(1.6, 5.4), box_cells(1.6, 5.4)] = True
    return [
        World(walls, RESOLUTION_M, name=name)
        for name, walls in (("hall", hall), ("twins", twins), ("ring", ring))
    ]


def drawn(width_m: float, height_m: float) -> np.ndarray:
    """(H, W) walls of an empty room with walls of 0.2 m."""
    walls = np.ones((round(height_m / RESOLUTION_M), round(width_m / RESOLUTION_M)), dtype=bool)
    walls[4:-4, 4:-4] = False
    return walls


def box_cells(low_m: float, high_m: float) -> slice:
    return slice(round(low_m / RESOLUTION_M), round(high_m / RESOLUTION_M))


def map_of(world: World) -> TernaryMap:
    """What a perfect run leaves of the world: faces of walls, and what is free."""
    is_free = ~world.is_occupied
    faces = ndimage.binary_dilation(is_free, np.ones((3, 3), dtype=bool)) & world.is_occupied
    return TernaryMap(
        resolution_m=world.resolution_m,
        origin_m=world.origin_m,
        is_occupied=faces,
        is_free=is_free,
    )


def measure(world: World, mapped: World, args: argparse.Namespace) -> Tally:
    is_foreign = mapped is not world
    name = f"{world.name} on {mapped.name}" if is_foreign else world.name
    tally = Tally(name)
    rng = np.random.default_rng([args.seed, zlib.crc32(name.encode())])
    eye = Eye(world, rng, args.revolutions)
    drive = Driver(world, rng)
    grid = map_of(mapped)
    for _ in range(args.places):
        localizer = GlobalLocalizer(grid, Pose2())
        scans = 0
        for pose, motion in drive.steps(args.scans):
            scan = eye.scan(pose)
            begun_s = time.process_time()  # others may be at work here
            verdict = localizer.step(scan, motion)
            tally.step_ms.append(1e3 * (time.process_time() - begun_s))
            scans += 1
            if isinstance(verdict, Located):
                break
        tally.places += 1
        if isinstance(verdict, Located):
            off_m = pose.distance_m(verdict.pose)
            off_rad = abs(wrap_rad(pose.heading_rad - verdict.pose.heading_rad))
            if off_m < RIGHT_M and off_rad < RIGHT_RAD and not is_foreign:
                tally.right += 1
                tally.scans.append(scans)
                tally.errors_m.append(off_m)
                tally.errors_deg.append(math.degrees(off_rad))
            else:
                tally.wrong += 1
        elif isinstance(verdict, Ambiguous):
            tally.ambiguous += 1
            off = verdict.poses - pose.as_array()
            is_true = (np.hypot(off[:, 0], off[:, 1]) < 2 * RIGHT_M) & (
                np.abs(wrap_rad(off[:, 2])) < 2 * RIGHT_RAD
            )
            tally.truth_among_rivals += bool(is_true.any())
        else:
            tally.lost += 1
    return tally


class Driver:
    """A robot set down anywhere that drives straight ways at random."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        radius_m = Config().robot.radius_m
        reachable = world.reachable(world.start_pose(None, radius_m), radius_m)
        self._blocked = world.clearance.field_m < radius_m
        self._spots = world.metres(np.argwhere(reachable) + 0.5)
        self._world, self._rng = world, rng

    def steps(self, count: int) -> Iterator[tuple[Pose2, MotionIncrement]]:
        """True poses, and what the odometry says of the way there."""
        x, y = self._spots[self._rng.integers(len(self._spots))].tolist()
        pose = Pose2(x, y, float(self._rng.uniform(-math.pi, math.pi)))
        yield pose, self._told(Pose2())
        for _ in range(count - 1):
            step = self._next(pose)
            pose = pose @ step
            yield pose, self._told(step)

    def _next(self, pose: Pose2) -> Pose2:
        """Turn to where there is room, drive a part of it."""
        turns = self._rng.uniform(-math.pi, math.pi, 12)
        cell = self._world.cells(np.array([[pose.x_m, pose.y_m]]))
        scale = self._world.resolution_m
        reach = STEP_MAX_M / scale
        room_m = (
            np.minimum(cast_rays(self._blocked, cell, pose.heading_rad + turns, reach), reach)
            * scale
        )
        turn = float(turns[int(np.argmax(np.minimum(room_m, self._rng.uniform(*STEPS, 12))))])
        way_m = max(0.0, min(float(self._rng.uniform(*STEPS)), float(room_m.max()) - scale))
        way_m = min(way_m, max(0.0, float(room_m[np.argmin(np.abs(turns - turn))]) - scale))
        return Pose2(0.0, 0.0, turn) @ Pose2(way_m, 0.0, 0.0)

    def _told(self, step: Pose2) -> MotionIncrement:
        way_m = math.hypot(step.x_m, step.y_m)
        std = np.hypot(
            FLOOR_STD,
            [
                *(SLIP_STD * way_m),
                math.hypot(TURN_STD_PER_RAD * step.heading_rad, TURN_STD_PER_M * way_m),
            ],
        )
        error = Pose2.from_array(self._rng.normal(0.0, std))
        return MotionIncrement(
            from_stamp_s=0.0, to_stamp_s=1.0, delta=step @ error, covariance=np.diag(std**2)
        )


STEPS = (STEP_MIN_M, STEP_MAX_M)
COLUMNS = (
    "world",
    "places",
    "right %",
    "wrong",
    "ambiguous (truth among rivals)",
    "lost",
    "scans median / max",
    "error m median / max",
    "error deg median / max",
    "ms per scan median / max",
)


def table(tallies: list[Tally], total: str) -> str:
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    return "\n".join(lines + [row(tally) for tally in [*tallies, sum_of(tallies, total)]])


def sum_of(tallies: list[Tally], name: str) -> Tally:
    whole = Tally(name)
    for tally in tallies:
        for key in ("places", "right", "wrong", "ambiguous", "truth_among_rivals", "lost"):
            setattr(whole, key, getattr(whole, key) + getattr(tally, key))
        for key in ("scans", "errors_m", "errors_deg", "step_ms"):
            getattr(whole, key).extend(getattr(tally, key))
    return whole


def row(tally: Tally) -> str:
    def pair(values: list, form: Callable[[float], str]) -> str:
        return f"{form(float(np.median(values)))} / {form(max(values))}" if values else "-"

    cells = [
        tally.name,
        str(tally.places),
        f"{100.0 * tally.right / max(1, tally.places):.0f}",
        str(tally.wrong),
        f"{tally.ambiguous} ({tally.truth_among_rivals})",
        str(tally.lost),
        pair(tally.scans, "{:.0f}".format),
        pair(tally.errors_m, "{:.3f}".format),
        pair(tally.errors_deg, "{:.2f}".format),
        pair(tally.step_ms, "{:.0f}".format),
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    raise SystemExit(main())
