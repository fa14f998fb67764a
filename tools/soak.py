# SPDX-License-Identifier: MIT
"""One daemon, run after run on the simulated robot for an hour of robot time: no growth.

    python tools/soak.py --hours 1 --world office --out runs/soak

Prints robot time, run, and resident memory after each run. The simulator lives in the same
process, so the daemon's own share is less than what is shown.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
from pathlib import Path

from ins_robot.config import load
from ins_robot.daemon.logging_setup import set_up
from ins_robot.daemon.runtime import Robot
from ins_robot.simulation.harness import SimulatedRobot
from ins_robot.simulation.virtual_clock import run_virtual
from ins_robot.simulation.world import World


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--world", default="office")
    parser.add_argument("--out", type=Path, default=Path("runs/soak"))
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    args = parser.parse_args()
    set_up("warning")
    run_virtual(soak(args))
    return 0


async def soak(args: argparse.Namespace) -> None:
    config = load(None, args.overrides)
    world = World.find(args.world)
    clock = asyncio.get_running_loop().time
    simulated = SimulatedRobot(config, world, world.start_pose(None, config.robot.radius_m), 0)
    connector = simulated.memory_connector(clock)
    robot = Robot(config, connector, clock_kind="virtual")

    async def direct() -> None:
        await robot.pipeline.complete.wait()
        run = 0
        while clock() < args.hours * 3600.0:
            run += 1
            directory = args.out / f"{run:03d}"
            shutil.rmtree(directory, ignore_errors=True)
            directory.mkdir(parents=True)
            robot.begin(directory, f"soak-{run}")
            await robot.finished.wait()
            assert robot.last_summary is not None
            print(
                f"{clock():7.0f} s  run {run:3d}  {robot.last_summary['state']:<9}"
                f"{robot.last_summary['scans']:4d} scans  "
                f"{robot.last_summary['path_length_m']:6.1f} m  rss {rss_mb():6.1f} MB",
                flush=True,
            )
        robot.supervisor.shut_down("the soak is over")

    robot.supervisor.add_task("simulator", lambda: simulated.pump(connector))
    robot.supervisor.add_task("director", direct)
    await robot.serve()


def rss_mb() -> float:
    """Resident memory now."""
    status = Path("/proc/self/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024.0


if __name__ == "__main__":
    raise SystemExit(main())
