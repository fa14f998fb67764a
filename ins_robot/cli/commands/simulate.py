# SPDX-License-Identifier: MIT
"""`ins-robot simulate`: the whole daemon explores a simulated world, on virtual time."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ins_robot.cli.config_source import add_config_argument, add_set_argument, load_config
from ins_robot.cli.interrupts import TerminateAsInterrupt
from ins_robot.cli.left_unseen import left_words
from ins_robot.errors import InputError
from ins_robot.simulation.shipped_worlds import shipped_worlds

if TYPE_CHECKING:
    from ins_robot.config import Config
    from ins_robot.geometry.pose2 import Pose2
    from ins_robot.mapping.zones import Zone
    from ins_robot.simulation.body_faults import BodyFault

PROGRESS_PERIOD_S = 5.0  # of robot time
XY, XYDEG = 2, 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `simulate`."""
    add_world_argument(parser)
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="where the files go"
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, help="of all noise (default: slam.seed, which is 0)"
    )
    add_start_argument(parser)
    parser.add_argument(
        "--zones",
        metavar="FILE",
        type=Path,
        help="no-go zones and virtual walls, as `zones list --json` prints them",
    )
    add_fault_argument(parser)
    parser.add_argument("--json", action="store_true", help="print summary.json on stdout")
    add_set_argument(parser)
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Explore; 0 when the run ended by itself or by its budget, 1 when it failed."""
    from dataclasses import replace

    from ins_robot.daemon.logging_setup import set_up
    from ins_robot.daemon.zone_store import read_zones
    from ins_robot.logs.run_directory import SUMMARY, json_bytes, prepare_directory
    from ins_robot.simulation.virtual_clock import run_virtual
    from ins_robot.simulation.world import World

    config = load_config(args)
    if args.seed is not None:
        check_seed(args.seed)
        config = replace(config, slam=replace(config.slam, seed=args.seed))
    world = World.find(args.world)
    start = world.start_pose(parse_start(args.start), config.robot.radius_m)
    zones = read_zones(args.zones) if args.zones is not None else ()
    faults = [parse_fault(words) for words in args.faults]
    if prepare_directory(args.out):
        print(f"{args.out}: replaces the run there", file=sys.stderr)
    set_up("warning")
    try:
        with TerminateAsInterrupt():
            summary = run_virtual(_simulate(config, world, start, args.out, zones, faults))
    except KeyboardInterrupt:
        is_saved = (args.out / SUMMARY).exists()
        kept = "what was mapped so far is" if is_saved else "before the run began: no map is"
        print(f"interrupted; {kept} in {args.out}", file=sys.stderr)
        raise
    if args.json:
        print(json_bytes(summary).decode(), end="")
    else:
        print(describe(summary, args.out))
    return 0 if summary["state"] != "failed" else 1


async def _simulate(
    config: Config,
    world: Any,
    start: Pose2,
    directory: Path,
    zones: tuple[Zone, ...],
    faults: list[tuple[BodyFault, float, float]],
) -> dict[str, Any]:
    import asyncio

    from ins_robot.daemon.runtime import Robot
    from ins_robot.mapping.map_picture import png_bytes
    from ins_robot.simulation.harness import SimulatedRobot

    clock = asyncio.get_running_loop().time
    simulated = SimulatedRobot(config, world, start, config.slam.seed)
    for fault, from_s, duration_s in faults:
        simulated.body.faults.add(fault, from_s, duration_s)
    connector = simulated.memory_connector(clock)
    robot = Robot(
        config, connector, clock_kind="virtual", annotate=simulated.annotate, draw=png_bytes
    )
    robot.supervisor.add_task("simulator", lambda: simulated.pump(connector))
    robot.supervisor.add_task(
        "director", lambda: _direct(robot, simulated.person, directory, zones)
    )
    await robot.serve()
    if robot.save_error is not None:
        raise robot.save_error
    assert robot.last_summary is not None
    return robot.last_summary


async def _direct(robot: Any, person: Any, directory: Path, zones: tuple[Zone, ...]) -> None:
    """Start one run once all devices are there, and shut down after it."""
    import asyncio

    await robot.pipeline.complete.wait()
    robot.begin(directory, directory.name or "simulated", zones)
    if robot.is_manual:
        robot.supervisor.add_task("person", lambda: _carry(robot.mission, person))
    is_terminal = sys.stderr.isatty()
    while not robot.finished.is_set():
        try:
            async with asyncio.timeout(PROGRESS_PERIOD_S):
                await robot.finished.wait()
        except TimeoutError:
            if robot.stop_latch.is_set:  # nobody is there to clear it
                await robot.end(robot.stop_latch.reason, failed=True)
            if is_terminal and robot.mission is not None:
                core = robot.mission.core
                print(
                    f"\r{core.last_stamp_s:6.0f} s  {core.path_length_m:6.1f} m  "
                    f"{core.scans:3d} scans  {robot.mission.state:<12}",
                    end="",
                    file=sys.stderr,
                    flush=True,
                )
    if is_terminal:
        print(file=sys.stderr)
    robot.supervisor.shut_down("the run is over")


async def _carry(mission: Any, person: Any) -> None:
    """A person on the manual base: carry the LRF where the run says, and say `here`."""
    from ins_robot.errors import DeviceError, StateError

    while not mission.state.is_over:
        goal = mission.goal
        if goal is not None:
            await person.walk(goal.path.points_m, goal.place)
        try:
            await mission.here()
        except StateError as error:  # it fits nowhere: the run says where to go instead
            print(f"{mission.name}: {error}", file=sys.stderr)
        except DeviceError as error:
            mission.stop(str(error), failed=True)


def check_seed(seed: int) -> None:
    """Refuse a seed that no generator takes."""
    if seed < 0:
        raise InputError(f"--seed {seed}: must be 0 or more")


def add_world_argument(parser: argparse.ArgumentParser) -> None:
    """Add the world, a file or a name."""
    parser.add_argument(
        "world",
        metavar="WORLD",
        nargs="?",
        default="rooms",
        help="ROS map_server YAML file, or one of the worlds that ship with the package: "
        f"{', '.join(shipped_worlds())} (default: rooms)",
    )


def add_start_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--start X,Y[,DEG]`."""
    parser.add_argument(
        "--start", metavar="X,Y[,DEG]", help="start pose in the world, metres and degrees"
    )


def parse_start(text: str | None) -> Pose2 | None:
    """`X,Y` or `X,Y,DEG` as a pose; None for none."""
    from ins_robot.geometry.pose2 import Pose2

    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (XY, XYDEG) or not all(abs(v) < float("inf") for v in values):
        raise InputError(f"--start {text}: expected X,Y or X,Y,DEG in metres and degrees")
    return Pose2(values[0], values[1], math.radians(values[2]) if len(values) == XYDEG else 0.0)


def add_fault_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--fault NAME FROM_S DURATION_S`, the words of each in `faults`."""
    parser.add_argument(
        "--fault",
        dest="faults",
        nargs=3,
        metavar=("NAME", "FROM_S", "DURATION_S"),
        action="append",
        default=[],
        help="let something go wrong for a while, in seconds since switching on, "
        "e.g. --fault slip_burst 30 1 (repeatable); an unknown NAME lists them all",
    )


def parse_fault(words: list[str]) -> tuple[BodyFault, float, float]:
    """`NAME FROM_S DURATION_S` as a fault, when it begins, and for how long."""
    from ins_robot.simulation.body_faults import BodyFault

    name, *times = words
    if name not in list(BodyFault):
        raise InputError(f"--fault {name}: no such fault; there are {', '.join(BodyFault)}")
    try:
        from_s, duration_s = map(float, times)
    except ValueError:
        from_s = duration_s = math.nan
    if not (0.0 <= from_s < math.inf and 0.0 <= duration_s < math.inf):
        raise InputError(
            f"--fault {' '.join(words)}: expected FROM_S and DURATION_S in seconds, 0 or more"
        )
    return BodyFault(name), from_s, duration_s


def describe(summary: dict[str, Any], directory: Path) -> str:
    """What a person wants to know of a run, in a few lines."""
    lines = [
        f"{summary['state']}: {summary['reason']}",
        f"{summary['scans']} scan{'s' * (summary['scans'] != 1)}, "
        f"{summary['path_length_m']:.1f} m, "
        f"{summary['duration_s']:.0f} s of robot time in {summary['wall_time_s']:.1f} s",
    ]
    if "coverage" in summary:
        lines.append(
            f"coverage {summary['coverage']:.3f}, wall error {summary['wall_error_m']:.3f} m, "
            f"localization {summary['localization_rmse_m']:.3f} m / "
            f"{summary['heading_rmse_deg']:.2f} deg, collisions {summary['collisions']}"
        )
    if left := left_words(summary):
        lines.append(left)
    blank = "" if summary["scans"] else " (blank: the run ended before its first scan)"
    lines.append(f"map: {directory / 'map.png'}{blank}")
    return "\n".join(lines)
