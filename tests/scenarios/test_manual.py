# SPDX-License-Identifier: MIT
"""A person carries the LRF through a building: the paper's emulation stage, on virtual time."""

import asyncio
import json
import math
from pathlib import Path

import pytest
from live_robot import Live, live
from PIL import Image

from ins_robot.cli.commands.where_next import words
from ins_robot.cli.main import main
from ins_robot.config import load
from ins_robot.core.carried_core import CarriedCore
from ins_robot.errors import ConfigError, DeviceError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping import palette
from ins_robot.simulation.virtual_clock import run_virtual

MANUAL = ("base.kind=manual",)


async def _walk_to_goal(at: Live) -> None:
    assert at.robot.mission is not None
    goal = at.robot.mission.goal
    assert goal is not None
    await at.simulated.person.walk(goal.path.points_m, goal.place)


@pytest.fixture(scope="module")
def hand_run(tmp_path_factory: pytest.TempPathFactory, ins_robot) -> tuple[Path, dict]:
    """`simulate rooms` with a person: directory and summary."""
    directory = tmp_path_factory.mktemp("hand")
    words = ["simulate", "rooms", "--seed", 0, "--set", "base.kind=manual"]
    done = ins_robot(*words, "--out", directory, "--json")
    return directory, json.loads(done.stdout)


def test_rooms_are_mapped_wholly_by_hand(hand_run: tuple[Path, dict]) -> None:
    _, summary = hand_run
    assert summary["state"] == "complete"
    assert summary["coverage"] >= 0.95
    assert summary["localization_rmse_m"] < 0.15
    assert summary["localization_max_m"] < 0.3  # not one scan at a wrong place
    assert summary["wall_error_m"] < 0.05
    assert 0.8 * summary["path_length_m"] < summary["true_path_length_m"]


def test_the_run_by_hand_replays_to_the_same_run(
    hand_run: tuple[Path, dict], tmp_path: Path, ins_robot
) -> None:
    directory, summary = hand_run
    again = json.loads(ins_robot("replay", directory, "--out", tmp_path, "--json").stdout)
    for key in ("state", "reason", "duration_s", "path_length_m", "scans", "refused_scans"):
        assert again[key] == summary[key]
    for name in ("map.pgm", "trajectory.tum", "graph.json"):
        assert (tmp_path / name).read_bytes() == (directory / name).read_bytes()


def test_a_scan_that_fits_nowhere_leaves_the_map_and_sends_the_person_back(
    tmp_path: Path,
) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("lost")
        await at.commands.here()
        await _walk_to_goal(at)
        await at.commands.here()
        mission = at.robot.mission
        assert mission is not None
        slam = mission.core.survey.slam
        poses = slam.node_poses
        grid = mission.core.survey.grid.log_odds.copy()
        await _walk_to_goal(at)
        good = at.simulated.body.pose
        at.simulated.body.carry(Pose2(good.x_m, good.y_m, good.heading_rad + math.pi))
        told = r"fits nowhere for certain \(.*[0-9].*\); .* go back towards node 1 and"
        with pytest.raises(StateError, match=told):
            await at.commands.here()
        assert (slam.node_poses == poses).all()
        assert (mission.core.survey.grid.log_odds == grid).all()
        assert isinstance(mission.core, CarriedCore)
        assert (mission.core.scans, mission.core.refused_scans) == (2, 1)
        assert mission.goal is not None
        assert mission.goal.node_id == 1
        with pytest.raises(StateError, match="no place to skip"):
            await at.commands.skip()
        await _walk_to_goal(at)
        await at.commands.here()
        assert mission.core.scans == 3
        await at.commands.skip()
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms", overrides=MANUAL, timeout_s=300.0))
    run, again = tmp_path / "0001-lost", tmp_path / "again"
    assert main(["replay", str(run), "--out", str(again)]) == 0
    for name in ("map.pgm", "trajectory.tum", "graph.json"):
        assert (again / name).read_bytes() == (run / name).read_bytes()


def test_an_lrf_unplugged_on_the_way_costs_the_scan_and_not_the_run(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("cable")
        await at.commands.here()
        goal = (await at.commands.next())["goal"]
        lrf, at.robot.pipeline._lrf = at.robot.pipeline._lrf, None
        with pytest.raises(DeviceError, match="not connected"):
            await at.commands.here()
        at.robot.pipeline._lrf = lrf
        assert (await at.commands.next())["goal"] == goal
        await _walk_to_goal(at)
        await at.commands.here()
        assert at.robot.mission is not None
        assert at.robot.mission.core.scans == 2
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms", overrides=MANUAL, timeout_s=300.0))


def test_what_is_told_leads_to_the_goal_and_is_drawn(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        with pytest.raises(StateError, match="no run is under way"):
            await at.commands.next()
        await at.commands.start("told")
        assert "where the map shall begin" in words(await at.commands.next())[0]
        told = await at.commands.here()
        there = Pose2(
            told["distance_m"] * math.cos(told["bearing_rad"]),
            told["distance_m"] * math.sin(told["bearing_rad"]),
            told["turn_rad"],
        )
        mission = at.robot.mission
        assert mission is not None
        goal = mission.goal
        assert goal is not None
        assert (mission.core.pose @ there).distance_m(goal.place) < 1e-9
        assert words(told)[0].startswith(f"go {told['distance_m']:.2f} m")
        (tmp_path / "next.png").write_bytes(await at.commands.next_picture())
        with Image.open(tmp_path / "next.png") as picture:
            assert palette.PURPLE in {colour for _, colour in picture.getcolors(1 << 24)}
        skipped = await at.commands.skip()
        assert skipped["goal"] != told["goal"]
        await at.commands.pause()
        with pytest.raises(StateError, match="paused"):
            await at.commands.here()
        await at.commands.resume()
        with pytest.raises(StateError, match="there are no motors"):
            await at.commands.estop()
        assert len(await at.commands.scan()) > 1000  # between two places the LRF is free
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms", overrides=MANUAL, timeout_s=300.0))


def test_an_order_cut_off_by_the_end_of_the_run_is_answered(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        await at.commands.start("short")
        asked = asyncio.ensure_future(at.commands.here())
        await asyncio.sleep(0.5)
        with pytest.raises(StateError, match="the run is scanning"):
            await at.commands.here()
        with pytest.raises(StateError, match="needs the LRF itself"):
            await at.commands.scan()
        await at.commands.stop()
        with pytest.raises(StateError, match="the run has ended: stopped by the operator"):
            await asked

    run_virtual(live(story, tmp_path, world="rooms", overrides=MANUAL, timeout_s=300.0))


def test_a_robot_on_wheels_tells_its_goal_and_is_not_carried(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        assert len(await at.commands.scan()) > 1000  # idle: whatever base there is
        await at.commands.start("wheels")
        while (await at.commands.next())["goal"] is None:  # noqa: ASYNC110 - no event for it
            await asyncio.sleep(0.1)
        assert words(await at.commands.next())[0].startswith("driving: goal ")
        with pytest.raises(StateError, match="drives by itself"):
            await at.commands.here()
        with pytest.raises(StateError, match="is under way and needs the LRF"):
            await at.commands.scan()
        await at.commands.stop()

    run_virtual(live(story, tmp_path, world="rooms"))


def test_a_carried_lrf_cannot_feed_slam_on_the_way() -> None:
    with pytest.raises(ConfigError, match="on_demand"):
        load(None, ["base.kind=manual", "lrf.power=continuous"])
