# SPDX-License-Identifier: MIT
"""Between runs: who knows where the robot is, who holds its wheels, what `goto` does then."""

import asyncio
import json
import math
from itertools import pairwise
from pathlib import Path

from live_robot import Live, live, run_slow

from ins_robot.logs.replay_journal import JournalOptions, replay_journal


async def until_fast(at: Live) -> None:
    """In the middle of a drive."""
    await at.until("driving")
    while math.hypot(at.robot.pilot.velocity.vx_mps, at.robot.pilot.velocity.vy_mps) < 0.17:  # noqa: ASYNC110 - no event
        await asyncio.sleep(0.02)


def test_a_run_stopped_in_full_drive_keeps_its_pose_while_it_is_saved(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("slow")
        await until_fast(at)
        core = at.robot.mission.core
        asyncio.get_running_loop().job_s = 10.0  # a slow card
        speeds = []
        at.robot.pipeline.on_tick = lambda now_s: speeds.append(
            math.hypot(at.robot.pilot.velocity.vx_mps, at.robot.pilot.velocity.vy_mps)
        )
        await at.commands.stop()
        await asyncio.sleep(1.0)
        assert core.pose.distance_m(at.true_place) < 0.02
        steps = [before - after for before, after in pairwise(speeds)]
        assert speeds[-1] == 0.0
        assert max(steps) < 0.05  # a ramp
        assert core.duration_s < asyncio.get_running_loop().time() - 10.0  # the run is over

    run_slow(live(story, tmp_path))
    run = tmp_path / "0001-slow"
    summary = json.loads((run / "summary.json").read_text())
    again = replay_journal(run / "run.journal", JournalOptions(), lambda: 0.0).summary()
    for key in ("duration_s", "path_length_m", "home_m"):
        assert again[key] == summary[key], key
