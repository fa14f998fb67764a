# SPDX-License-Identifier: MIT
"""In real time, a heavy SLAM step leaves the event loop alone: set points keep coming."""

import asyncio
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from ins_robot.config import load
from ins_robot.core.run_core import RunCore
from ins_robot.daemon.runtime import Robot
from ins_robot.simulation.harness import SimulatedRobot
from ins_robot.simulation.world import World

HEAVY_S = 0.6  # a SLAM step on a slow machine


def test_control_keeps_its_tick_while_a_slam_step_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light = RunCore.compute
    stretches: list[tuple[float, float]] = []
    computed = threading.Event()

    def heavy(self, job):
        begun_s = time.monotonic()
        outcome = light(self, job)
        time.sleep(HEAVY_S)
        stretches.append((begun_s, time.monotonic()))
        computed.set()
        return outcome

    monkeypatch.setattr(RunCore, "compute", heavy)
    ticks = asyncio.run(_ticks_of_a_first_scan(tmp_path, computed))
    begun_s, ended_s = stretches[0]
    during = [t for t in ticks if begun_s < t < ended_s]
    assert len(during) > 0.7 * 50 * (ended_s - begun_s)
    gaps = [b - a for a, b in pairwise(during)]
    assert max(gaps) < 0.15  # the dead-man's 0.2 s is never near


async def _ticks_of_a_first_scan(directory: Path, computed: threading.Event) -> list[float]:
    """Times at which wheel speeds went out, until the first scan has been computed."""
    config = load(None)
    world = World.find("rooms")
    clock = asyncio.get_running_loop().time
    start = world.start_pose(None, config.robot.radius_m)
    simulated = SimulatedRobot(config, world, start, 0, clock())
    connector = simulated.memory_connector(clock)
    robot = Robot(config, connector)
    ticks: list[float] = []
    robot.pipeline.on_tick = lambda _: ticks.append(time.monotonic())

    async def direct() -> None:
        async with asyncio.timeout(60.0):
            await robot.pipeline.complete.wait()
            robot.begin(directory, "tick")
            await asyncio.to_thread(computed.wait)
        robot.supervisor.shut_down("seen enough")

    robot.supervisor.add_task("simulator", lambda: simulated.pump(connector))
    robot.supervisor.add_task("director", direct)
    await robot.serve()
    return ticks
