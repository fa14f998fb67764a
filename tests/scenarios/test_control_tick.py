# SPDX-License-Identifier: MIT
"""In real time, a heavy SLAM step leaves the event loop alone: set points keep coming."""

import asyncio
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest
from live_robot import Live, live

from ins_robot.core.run_core import RunCore

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
    ticks: list[float] = []

    async def story(at: Live) -> None:
        at.robot.pipeline.on_tick = lambda _: ticks.append(time.monotonic())
        at.robot.begin(directory, "tick")
        await asyncio.to_thread(computed.wait)

    await live(story, directory, world="rooms", timeout_s=60.0)
    return ticks
