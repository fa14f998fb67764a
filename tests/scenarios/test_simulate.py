# SPDX-License-Identifier: MIT
"""The whole daemon explores a world by itself, leaves its files, and can be replayed."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ins_robot.logs.run_directory import read_tum

FILES = "map.png map.pgm map.yaml trajectory.tum graph.json summary.json truth.tum run.journal"
KEYS = """state reason duration_s path_length_m scans nodes loop_closures lrf_on_s ins_ms_total
slam_ms_median slam_ms_p95 wall_time_s peak_rss_mb coverage wall_error_m collisions
localization_rmse_m heading_rmse_deg"""


def test_it_ends_by_itself_with_a_good_map(rooms_run: tuple[Path, dict]) -> None:
    _, summary = rooms_run
    assert summary["state"] == "complete"
    assert summary["collisions"] == 0
    assert summary["coverage"] >= 0.97
    assert summary["localization_rmse_m"] <= 0.10
    assert summary["heading_rmse_deg"] <= 3.0
    assert summary["peak_rss_mb"] <= 200.0  # the daemon's 150 and the simulator


def test_every_file_and_key_is_there(rooms_run: tuple[Path, dict]) -> None:
    directory, summary = rooms_run
    assert all((directory / name).stat().st_size > 0 for name in FILES.split())
    assert set(KEYS.split()) <= set(summary)
    assert json.loads((directory / "summary.json").read_text()) == summary
    graph = json.loads((directory / "graph.json").read_text())
    assert len(graph["nodes"]) == summary["nodes"]
    for node in graph["nodes"]:
        assert {"id", "stamp_s", "x_m", "y_m", "heading_rad", "sector", "neighbours"} <= set(
            node
        )
        assert all({"width_m", "state"} <= set(gap) for gap in node["gaps"])
    with Image.open(directory / "map.png") as picture:
        assert min(picture.size) > 100


def test_the_trajectory_is_near_the_truth_everywhere(rooms_run: tuple[Path, dict]) -> None:
    directory, summary = rooms_run
    stamps, poses = read_tum(directory / "trajectory.tum")
    true_stamps, truth = read_tum(directory / "truth.tum")
    np.testing.assert_array_equal(stamps, true_stamps)
    off = np.hypot(*(poses[:, :2] - truth[:, :2]).T)
    assert off.max() < 0.25
    assert np.sqrt((off**2).mean()) == pytest.approx(summary["localization_rmse_m"], abs=1e-3)


def test_lrf_is_on_only_while_scanning(rooms_run: tuple[Path, dict]) -> None:
    _, summary = rooms_run
    assert 0.0 < summary["lrf_on_s"] < 0.6 * summary["duration_s"]


def test_a_continuous_lrf_is_on_all_the_time_and_feeds_slam_on_the_way(
    ins_robot, tmp_path: Path
) -> None:
    words = ("--seed", 0, "--out", tmp_path, "--json", "--set", "lrf.power=continuous")
    summary = json.loads(ins_robot("simulate", "clutter", *words).stdout)
    assert summary["state"] == "complete"
    assert summary["coverage"] >= 0.97
    assert summary["localization_rmse_m"] <= 0.10
    assert summary["lrf_on_s"] > 0.95 * summary["duration_s"]
    assert summary["sweeps"] > summary["duration_s"]  # three turns a second, but standing


def _faults(*episodes: tuple[str, float, float]) -> list[object]:
    return [word for episode in episodes for word in ("--fault", *episode)]


SLIPS = _faults(*[("slip_burst", from_s, 1) for from_s in range(10, 200, 20)])
TURNED_COMPASS = _faults(("compass_disturbed", 40, 1000))
GYRO_STEP = _faults(("gyro_bias_step", 20, 30))


@pytest.mark.parametrize(
    "faults",
    [
        pytest.param([*SLIPS, *TURNED_COMPASS], id="slips and compass"),
        pytest.param(
            [*SLIPS, *TURNED_COMPASS, *GYRO_STEP],
            id="and gyro",
        ),
    ],
)
def test_a_map_survives_disturbances_on_purpose(
    ins_robot, tmp_path: Path, faults: list[object]
) -> None:
    """Without metal around, or the compass would hardly be listened to."""
    options = ("exploration.return_home=false", "simulation.compass_disturbance=0")
    words = [word for option in options for word in ("--set", option)]
    done = ins_robot("simulate", "clutter", "--out", tmp_path, "--json", *words, *faults)
    summary = json.loads(done.stdout)
    assert summary["state"] == "complete"
    assert summary["collisions"] == 0
    assert summary["coverage"] >= 0.98
    assert summary["localization_rmse_m"] <= 0.06
    assert summary["heading_rmse_deg"] <= 1.0
    assert {fault["fault"] for fault in summary["faults"]} == set(faults[1::4])


def test_the_first_scan_looks_all_around_and_later_ones_forward(
    rooms_run: tuple[Path, dict],
) -> None:
    directory, _ = rooms_run
    nodes = json.loads((directory / "graph.json").read_text())["nodes"]
    half_deg = [math.degrees(node["sector"][1]) for node in nodes]
    assert half_deg == pytest.approx([180.0] + [150.0] * (len(nodes) - 1))


def test_the_same_seed_gives_the_same_bytes(
    ins_robot, tmp_path: Path, rooms_run: tuple[Path, dict]
) -> None:
    directory, _ = rooms_run
    ins_robot("simulate", "rooms", "--seed", 0, "--out", tmp_path)
    for name in ["map.pgm", "map.yaml", "trajectory.tum", "graph.json", "truth.tum"]:
        assert (tmp_path / name).read_bytes() == (directory / name).read_bytes(), name


def test_replaying_the_recording_gives_the_run_again(
    ins_robot, tmp_path: Path, rooms_run: tuple[Path, dict]
) -> None:
    directory, summary = rooms_run
    done = ins_robot("replay", directory / "run.journal", "--out", tmp_path, "--json")
    for name in ["map.pgm", "map.yaml", "trajectory.tum", "graph.json"]:
        assert (tmp_path / name).read_bytes() == (directory / name).read_bytes(), name
    again = json.loads(done.stdout)
    for key in ["state", "reason", "duration_s", "path_length_m", "scans", "nodes", "lrf_on_s"]:
        assert again[key] == summary[key], key


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["simulate", "nowhere.yaml"], "nowhere.yaml"),
        (["simulate", "rooms", "--start", "1"], "--start 1: expected X,Y"),
        (["simulate", "rooms", "--start", "-50,-50"], "-50"),
        (["simulate", "rooms", "--fault", "hail", "1", "1"], "there are slip_burst, stuck, "),
        (["simulate", "rooms", "--set", "lrf.rmp=200"], "did you mean 'rpm'"),
        (["simulate", "rooms", "--set", "lrf.rpm=20"], "at least 180"),
        (["replay", "nowhere.clf"], "nowhere.clf"),
    ],
)
def test_bad_input_is_one_clear_line_and_leaves_nothing(
    ins_robot, words: list[str], says: str, tmp_path: Path
) -> None:
    done = ins_robot(*words, "--out", tmp_path / "out", check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert len(done.stderr.strip().splitlines()) == 1
    assert says in done.stderr
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())
