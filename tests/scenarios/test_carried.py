# SPDX-License-Identifier: MIT
"""A robot that was paused looks where it is before it goes on: it may have been carried."""

import asyncio
import json
import math
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from live_robot import Live, live

from ins_robot.core.run_core import RunCore
from ins_robot.core.whereabouts import Here, PutDown, Unknown
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import read_journal
from ins_robot.logs.replay_journal import JournalOptions, replay_journal
from ins_robot.messages import Mark
from ins_robot.simulation.virtual_clock import run_virtual

pytestmark = pytest.mark.timeout(300)  # whole runs
ROOMS_START = Pose2(5.0, 4.0, math.radians(90.0))


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list:
    """What each look after a pause has told, in order."""
    told, find = [], RunCore.find_itself

    def noted(self, *asked, **named):
        told.append(find(self, *asked, **named))
        return told[-1]

    monkeypatch.setattr(RunCore, "find_itself", noted)
    return told


async def paused_on_the_way(at: Live, scans: int) -> None:
    """Paused and standing, in the drive after that many scans."""
    await at.commands.start("carried")
    while at.robot.mission.core.scans < scans:  # noqa: ASYNC110 - no event
        await asyncio.sleep(0.1)
    await at.until("driving")
    await asyncio.sleep(2.0)
    await at.commands.pause()
    await asyncio.sleep(2.0)
    assert (await at.commands.status())["state"] == "paused"


def summary_of(runs: Path) -> dict:
    return json.loads((runs / "0001-carried" / "summary.json").read_text())


def marks_of(runs: Path) -> Counter:
    _, messages = read_journal(runs / "0001-carried" / "run.journal")
    return Counter(message.kind for message in messages if isinstance(message, Mark))


def assert_replays(runs: Path) -> None:
    run = runs / "0001-carried"
    summary = summary_of(runs)
    again = replay_journal(run / "run.journal", JournalOptions(), lambda: 0.0)
    assert json.loads(json.dumps(again.graph)) == json.loads((run / "graph.json").read_text())
    told = again.summary()
    for key in ("path_length_m", "scans", "sweeps", "nodes", "home_m", "reason"):
        assert told[key] == summary[key], key
    assert told.get("relocalisations") == summary.get("relocalisations")


def assert_good(summary: dict) -> None:
    assert (summary["state"], summary["reason"]) == ("complete", "no reachable gap is left")
    assert summary["collisions"] == 0
    assert summary["coverage"] >= 0.97
    assert summary["localization_max_m"] <= 0.10
    assert summary["heading_rmse_deg"] <= 1.0
    assert summary["wall_error_m"] <= 0.04  # torn walls would stand twice
    assert summary["true_home_m"] <= 0.15


@pytest.fixture(scope="module")
def far_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Carried 3.5 m and turned by 150 degrees to where the run began."""
    runs = tmp_path_factory.mktemp("far")

    async def story(at: Live) -> None:
        await paused_on_the_way(at, 5)
        here = at.simulated.body.pose
        assert here.distance_m(ROOMS_START) > 2.5
        at.simulated.body.kidnap(Pose2(5.0, 4.0, -2.0))
        await at.commands.resume()
        await at.robot.finished.wait()

    run_virtual(live(story, runs, world="rooms", timeout_s=900.0))
    return runs


def test_carried_to_a_room_it_knows_it_finds_itself_and_goes_on(far_run: Path) -> None:
    summary = summary_of(far_run)
    assert_good(summary)
    assert summary["relocalisations"] == 1
    assert summary["path_length_m"] == pytest.approx(summary["true_path_length_m"], rel=0.02)
    run = far_run / "0001-carried"
    way = np.loadtxt(run / "trajectory.tum")
    steps = [(math.dist(a[1:3], b[1:3]), b[0] - a[0]) for a, b in pairwise(way)]
    jumps = [step for step in steps if step[0] > 0.5]
    assert len(jumps) == 1  # the carrying, of which nothing is told in between
    assert jumps[0][1] > 2.0


def test_the_recording_of_a_carried_robot_replays_bit_for_bit(
    far_run: Path, ins_robot, tmp_path: Path
) -> None:
    run = far_run / "0001-carried"
    assert marks_of(far_run)["look"] == 2
    ins_robot("replay", run / "run.journal", "--out", tmp_path)
    for name in ["map.pgm", "map.yaml", "trajectory.tum", "graph.json"]:
        assert (tmp_path / name).read_bytes() == (run / name).read_bytes(), name
    assert_replays(far_run)


def test_paused_and_left_alone_it_looks_once_and_goes_on(tmp_path: Path, found: list) -> None:
    async def story(at: Live) -> None:
        await paused_on_the_way(at, 2)
        core = at.robot.mission.core
        before, scans, sweeps = core.pose, core.scans, core.sweeps
        nodes = len(core.survey.explorer.graph)
        await at.commands.resume()
        while not found:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.02)
        assert core.pose.distance_m(before) < 0.02
        assert (core.scans, core.sweeps) == (scans, sweeps + 1)
        assert len(core.survey.explorer.graph) == nodes
        at_m = at.simulated.body.path_length_m
        while at.simulated.body.path_length_m < at_m + 0.3:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.1)
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms"))
    assert [type(told) for told in found] == [Here]
    assert "relocalisations" not in summary_of(tmp_path)
    assert_replays(tmp_path)


def test_nudged_it_finds_itself_at_the_first_look(tmp_path: Path, found: list) -> None:
    async def story(at: Live) -> None:
        await paused_on_the_way(at, 4)
        body = at.simulated.body
        body.kidnap(body.pose @ Pose2(0.14, 0.14, math.radians(10.0)))
        await at.commands.resume()
        while not found:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.02)
        core = at.robot.mission.core
        assert core.pose.distance_m(at.true_place) < 0.03
        while core.scans < 7:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.1)
        await at.until("driving")
        assert core.pose.distance_m(at.true_place) < 0.03
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms", timeout_s=900.0))
    assert [type(told) for told in found] == [PutDown]
    summary = summary_of(tmp_path)
    assert summary["relocalisations"] == 1
    assert (summary["collisions"], summary["wall_error_m"] < 0.04) == (0, True)
    assert_replays(tmp_path)


def test_carried_off_the_map_it_pauses_and_says_why_until_it_is_put_back(
    tmp_path: Path, found: list
) -> None:
    async def story(at: Live) -> None:
        await paused_on_the_way(at, 4)
        core, body, before = at.robot.mission.core, at.simulated.body, at.simulated.body.pose
        nodes, known = len(core.survey.slam.nodes), core.survey.grid.log_odds.copy()
        scans = core.scans
        body.kidnap(Pose2(8.5, 1.6, 1.0))
        await at.commands.resume()
        await asyncio.sleep(30.0)
        status = await at.commands.status()
        assert status["state"] == "paused"
        assert "what the LRF sees" in status["paused_because"]
        assert "put the robot back near x " in status["paused_because"]
        assert "\n" not in status["paused_because"]
        assert body.path_length_m == pytest.approx(core.path_length_m, rel=0.05)
        assert (len(core.survey.slam.nodes), core.scans) == (nodes, scans)
        assert (core.survey.grid.log_odds == known).all()
        body.kidnap(before)
        await at.commands.resume()
        assert (await at.commands.status())["paused_because"] == ""
        await at.robot.finished.wait()

    few = ("exploration.max_scans=6",)
    run_virtual(live(story, tmp_path, world="rooms", overrides=few, timeout_s=900.0))
    assert [type(told) for told in found] == [Unknown] * 3 + [Here]
    summary = summary_of(tmp_path)
    assert summary["reason"] == "max_scans = 6 reached"
    assert (summary["collisions"], summary["wall_error_m"] < 0.04) == (0, True)
    assert summary["true_home_m"] <= 0.15
    assert_replays(tmp_path)


def test_in_a_corridor_that_looks_alike_all_along_it_goes_on(
    tmp_path: Path, found: list
) -> None:
    world = corridor(tmp_path)

    async def story(at: Live) -> None:
        await paused_on_the_way(at, 2)
        await at.commands.resume()
        while not found:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.02)
        assert at.robot.mission.core.pose.distance_m(at.true_place) < 0.3
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world=str(world)))
    assert [type(told) for told in found] == [Here]


def corridor(directory: Path) -> Path:
    """A world: 40 m by 1.5 m, the ends out of sight from where the robot begins."""
    cells = np.zeros((32, 802), np.uint8)
    cells[1:-1, 1:-1] = 254
    (directory / "corridor.pgm").write_bytes(b"P5 802 32 255\n" + cells.tobytes())
    world = directory / "corridor.yaml"
    world.write_text(
        "image: corridor.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\nstart: [20.0, 0.8, 0.0]\n"
    )
    return world


def test_carried_while_it_scans_or_turns_its_lrf_all_the_time_nothing_of_that_is_mapped(
    tmp_path: Path, found: list
) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("carried")
        while at.robot.mission.core.scans < 3:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.1)
        await at.until("driving")
        await at.until("scanning")
        core, body, before = at.robot.mission.core, at.simulated.body, at.simulated.body.pose
        nodes, scans = len(core.survey.slam.nodes), core.scans
        await at.commands.pause()
        body.kidnap(Pose2(5.0, 4.0, -2.0))
        await asyncio.sleep(20.0)
        assert (len(core.survey.slam.nodes), core.scans) == (nodes, scans)
        body.kidnap(before)
        await at.commands.resume()
        while not found:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.02)
        await at.until("driving")
        assert core.pose.distance_m(at.true_place) < 0.03
        await at.commands.stop()

    power = "lrf.power='continuous'"
    run_virtual(live(story, tmp_path, world="rooms", overrides=(power,), timeout_s=300.0))
    assert [type(told) for told in found] == [Here]
    assert_replays(tmp_path)
