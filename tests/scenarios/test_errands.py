# SPDX-License-Identifier: MIT
"""Home before the time is up, goto within a run and after one, zones: on the wire."""

import asyncio
import json
from pathlib import Path

import pytest
from live_robot import Live, live

from ins_robot.errors import InputError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.replay_journal import JournalOptions, replay_journal
from ins_robot.simulation.virtual_clock import run_virtual


def test_the_time_allowed_is_enough_to_come_home(ins_robot, tmp_path: Path) -> None:
    out, again = tmp_path / "run", tmp_path / "again"
    limit = ["--set", "exploration.max_time_s=110"]
    done = ins_robot("simulate", "rooms", "--seed", 1, "--out", out, "--json", *limit)
    summary = json.loads(done.stdout)
    assert summary["state"] == "stopped"
    assert summary["reason"] == "exploration.max_time_s = 110 s is used up"
    assert 30.0 < summary["duration_s"] <= 110.0
    assert summary["true_home_m"] <= 0.15
    assert {"unexplored"} <= {left["state"] for left in summary["left"]}
    assert all(left["why"] for left in summary["left"])
    ins_robot("replay", out / "run.journal", "--out", again)
    for name in ["map.pgm", "trajectory.tum", "graph.json"]:
        assert (again / name).read_bytes() == (out / name).read_bytes(), name
    replayed = json.loads((again / "summary.json").read_text())
    assert (replayed["left"], replayed["home_m"]) == (summary["left"], summary["home_m"])


def test_goto_in_a_run_and_after_it_and_zones(tmp_path: Path) -> None:
    """One robot's day: forbid a corner, start, send it about, stop, send it home."""

    async def story(at: Live) -> None:
        with pytest.raises(StateError, match="no map"):
            await at.commands.goto(1.0, 0.0)
        zone = {"name": "rug", "kind": "no-go", "points": [[9, 9], [10, 9], [9, 10]]}
        await at.commands.add_zone(zone)
        with pytest.raises(InputError, match="already one"):
            await at.commands.add_zone(zone)
        await at.commands.start("day")
        await at.until("driving")
        with pytest.raises(StateError, match="cannot be reached"):
            await at.commands.goto(60.0, 0.0)
        await at.commands.goto(0.6, 0.4)
        scans = at.robot.mission.core.scans
        while at.robot.mission.core.scans == scans:  # noqa: ASYNC110 - no event
            await asyncio.sleep(0.1)
        assert at.true_place.distance_m(Pose2(0.6, 0.4)) < 0.15
        await at.commands.add_zone({"name": "w", "kind": "wall", "points": [[9, 0], [9, 1]]})
        await asyncio.sleep(1.0)
        await at.commands.stop()
        with pytest.raises(StateError, match="cannot be reached"):
            await at.commands.goto(60.0, 0.0)
        await at.commands.goto(0.0, 0.0)
        await at.robot.finished.wait()
        assert at.robot.last_goto == "arrived at 0 0"
        assert at.true_place.distance_m(Pose2()) < 0.15
        far = {"name": "far", "kind": "no-go", "points": [[0.4, 0], [2, 1], [2, -1]]}
        await at.commands.add_zone(far)  # after the run, on its map
        with pytest.raises(StateError, match="no-go zone 'far'"):
            await at.commands.goto(1.0, 0.0)
        await at.commands.remove_zone("far")
        await at.commands.goto(0.6, 0.4)
        await at.commands.add_zone({**far, "points": [[8, 8], [9, 8], [8, 9]]})
        await at.robot.finished.wait()
        assert at.robot.last_goto == "arrived at 0.6 0.4"
        await at.commands.remove_zone("far")
        await at.commands.remove_zone("rug")
        with pytest.raises(InputError, match="no zone 'rug'"):
            await at.commands.remove_zone("rug")
        assert [z["name"] for z in await at.commands.zones()] == ["w"]

    run_virtual(live(story, tmp_path, timeout_s=400.0))
    run = tmp_path / "0001-day"
    assert [z["name"] for z in json.loads((run / "zones.json").read_text())] == ["rug", "w"]
    summary = json.loads((run / "summary.json").read_text())
    again = replay_journal(run / "run.journal", JournalOptions(), lambda: 0.0)
    assert again.path_length_m == pytest.approx(summary["path_length_m"], abs=1e-3)
    assert again.scans == summary["scans"]
    assert [zone.name for zone in again.zones] == ["rug", "w"]
    assert json.loads(json.dumps(again.graph)) == json.loads((run / "graph.json").read_text())


def test_a_place_too_far_for_the_budget_is_refused_and_exploring_goes_on(tmp_path: Path):
    async def story(at: Live) -> None:
        await at.commands.start("short")
        await at.until("driving")
        with pytest.raises(StateError, match="too far: on the way home"):
            await at.commands.goto(2.6, 0.45)
        await at.robot.finished.wait()
        await at.commands.goto(2.6, 0.45)  # what the run had used up is the run's
        await at.robot.finished.wait()
        assert at.robot.last_goto == "arrived at 2.6 0.45"

    run_virtual(
        live(story, tmp_path, overrides=("exploration.max_distance_m=5.9",), timeout_s=400.0)
    )
    run = tmp_path / "0001-short"
    summary = json.loads((run / "summary.json").read_text())
    assert summary["reason"] == "exploration.max_distance_m = 5.9 m is used up"
    assert summary["scans"] >= 2
    assert summary["path_length_m"] <= 5.9
    assert summary["home_m"] <= 0.15
    again = replay_journal(run / "run.journal", JournalOptions(), lambda: 0.0)
    assert again.scans == summary["scans"]
    assert json.loads(json.dumps(again.graph)) == json.loads((run / "graph.json").read_text())
