# SPDX-License-Identifier: MIT
"""Between runs: who knows where the robot is, who holds its wheels, what `goto` does then."""

import asyncio
import json
import math
from itertools import pairwise
from pathlib import Path

import pytest
from live_robot import Live, live, run_slow

from ins_robot.core.run_core import RunCore
from ins_robot.daemon.after_run import AfterRun
from ins_robot.daemon.mission import Mission
from ins_robot.errors import DeviceError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.replay_journal import JournalOptions, replay_journal
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.simulation.virtual_clock import run_virtual

LATE = Zone(name="late", kind=ZoneKind.WALL, points_m=((9.0, 0.0), (9.0, 1.0)))


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
        async with asyncio.TaskGroup() as group:
            group.create_task(at.commands.stop())
            await asyncio.sleep(0.1)
            assert speeds[-1] > 0.05  # the ramp
            group.create_task(at.robot.forbid((LATE,)))
        await asyncio.sleep(1.0)
        assert core.survey.explorer.bounds.zones == (LATE,)  # but not the run's
        assert not (tmp_path / "0001-slow" / "zones.json").exists()
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


def test_goto_after_a_run_is_free_of_its_pause_and_has_an_lrf_that_turns(
    tmp_path: Path,
) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("held")
        mission = await at.until("driving")
        await at.commands.pause()
        await at.commands.stop()
        mission.core.survey.explorer.blindness.scans = 4  # as after a cover that is gone by now
        await at.commands.goto(0.6, 0.4)
        await at.robot.finished.wait()
        assert at.robot.last_goto == "arrived at 0.6 0.4"
        assert at.true_place.distance_m(Pose2(0.6, 0.4)) < 0.15

    power = "lrf.power='continuous'"
    run_virtual(live(story, tmp_path, overrides=(power,), timeout_s=400.0))


def test_the_look_before_a_goto_after_a_run_has_the_lrf_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = AfterRun._sweep

    async def story(at: Live) -> None:
        is_looking, may_look = asyncio.Event(), asyncio.Event()

        async def held(self) -> None:
            is_looking.set()
            await may_look.wait()
            await look(self)

        monkeypatch.setattr(AfterRun, "_sweep", held)
        await at.commands.start("short")
        mission = await at.until("driving")
        await at.commands.stop()
        mission.core.survey.explorer.blindness.scans = 4  # it must look before it goes
        async with asyncio.TaskGroup() as group:
            going = group.create_task(at.commands.goto(0.6, 0.4))
            await is_looking.wait()
            refusals = [
                await _refusal(at.commands.start("b")),
                await _refusal(at.commands.scan()),
                await _refusal(at.commands.goto(1.0, 0.0)),
            ]
            assert not going.done()
            may_look.set()
        assert refusals == ["the LRF is busy with `ins-robot goto`: wait a moment"] * 3
        await at.robot.finished.wait()
        assert at.robot.last_goto == "arrived at 0.6 0.4"
        at.robot.single_scan.check_idle()

    run_virtual(live(story, tmp_path, timeout_s=400.0))
    assert not list(tmp_path.glob("*-b"))


@pytest.mark.parametrize("is_missing", [True, False])
def test_a_run_that_devices_failed_leaves_no_place_to_go_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_missing: bool
) -> None:
    async def fail(*args: object) -> None:
        raise DeviceError("motors: gone")

    async def story(at: Live) -> None:
        await at.commands.start("lost")
        mission = await at.until("driving")
        if is_missing:
            at.robot.pipeline._motor = None
            await at.commands.stop()
        else:
            monkeypatch.setattr(Mission, "_take_up", fail)
            await at.robot.finished.wait()
            assert mission.reason == "motors: gone"
        with pytest.raises(StateError, match="the robot is on no map"):
            await at.commands.goto(0.6, 0.4)
        assert at.robot.pipeline.mission is None

    run_virtual(live(story, tmp_path))


def test_an_emergency_stop_while_a_goto_after_a_run_is_looked_at_refuses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = RunCore.go_to

    async def story(at: Live) -> None:
        def stop_then_look(self, *asked):
            at.robot.stop_motors("now")
            return look(self, *asked)

        await at.commands.start("short")
        await at.until("driving")
        await at.commands.stop()
        monkeypatch.setattr(RunCore, "go_to", stop_then_look)
        with pytest.raises(StateError, match="stopped: now"):
            await at.commands.goto(0.6, 0.4)
        assert at.robot.mission is None

    run_virtual(live(story, tmp_path))


def test_who_asked_for_a_place_is_answered_when_the_run_ends_during_the_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, looks = RunCore.go_to, []

    def noted(self, *asked):
        looks.append(asked)
        return look(self, *asked)

    async def story(at: Live) -> None:
        await at.commands.start("short")
        await at.until("driving")
        monkeypatch.setattr(RunCore, "go_to", noted)
        asyncio.get_running_loop().job_s = 1.0
        async with asyncio.TaskGroup() as group:
            asking = group.create_task(_refusal(at.commands.goto(0.6, 0.4)))
            while not looks:  # noqa: ASYNC110 - no event
                await asyncio.sleep(0.1)
            await at.commands.stop()
        assert "the run has ended" in asking.result()

    run_slow(live(story, tmp_path))


async def _refusal(asked) -> str:
    with pytest.raises(StateError) as told:
        await asked
    return str(told.value)


def test_a_scan_that_is_being_computed_counts_though_the_run_is_stopped(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("cut")
        mission = await at.until("driving")
        while mission.core.scans < 2 or str(mission.state) != "thinking":
            asyncio.get_running_loop().job_s = 0.8
            await asyncio.sleep(0.05)
        await at.commands.stop()

    run_slow(live(story, tmp_path))
    run = tmp_path / "0001-cut"
    summary = json.loads((run / "summary.json").read_text())
    marks, cuts = [], []
    path, options = run / "run.journal", JournalOptions()
    again = replay_journal(path, options, lambda: 0.0, marks.append)
    assert again.summary()["home_m"] == summary["home_m"]
    count = len(marks)
    marks.clear()

    def is_stopped() -> bool:  # a signal that comes during the last mark
        cuts.append(len(marks) >= count)
        return cuts[-1]

    late = replay_journal(path, options, lambda: 0.0, marks.append, is_stopped)
    assert late.summary()["reason"] == "stopped by the operator"
    assert not any(cuts)
