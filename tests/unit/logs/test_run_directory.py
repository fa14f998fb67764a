# SPDX-License-Identifier: MIT
"""Scenarios of a run's files: all there, readable, whole or absent."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from ins_robot.core.run_result import RunResult, RunState, path_length_m
from ins_robot.errors import InputError
from ins_robot.logs import run_directory
from ins_robot.mapping.map_files import TernaryMap, read_map

REQUIRED = {
    *("state", "reason", "duration_s", "path_length_m", "scans", "nodes", "loop_closures"),
    *(
        "lrf_on_s",
        "ins_ms_total",
        "slam_ms_median",
        "slam_ms_p95",
        "wall_time_s",
        "peak_rss_mb",
    ),
}


GAP = {"ends": [[0.5, 0.5], [0.7, 0.5]], "width_m": math.inf, "state": "unexplored"}


def result(**changes):
    is_free = np.zeros((64, 64), dtype=bool)
    is_free[20:40, 20:50] = True
    poses = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.linspace(-3, 3, 50)])
    values = {
        "name": "0001-test",
        "state": RunState.COMPLETE,
        "reason": "no passable gap is left",
        "grid": TernaryMap(
            resolution_m=0.05,
            origin_m=(-1.6, -1.6),
            is_occupied=np.zeros_like(is_free),
            is_free=is_free,
        ),
        "stamps_s": 976052857.337486 + 0.1 * np.arange(50),
        "map_from_base": poses,
        "graph": {
            "nodes": [
                {
                    "id": i,
                    "stamp_s": float(i),
                    "x_m": 0.1 * i,
                    "y_m": 0.0,
                    "heading_rad": 0.0,
                    "sector": {"centre_rad": 0.0, "half_width_rad": math.pi},
                    "neighbours": [1 - i],
                    "gaps": [GAP],
                }
                for i in range(2)
            ]
        },
        "robot_radius_m": 0.2,
        "duration_s": 5.0,
        "path_length_m": path_length_m(poses),
        "scans": 2,
        "nodes": 2,
        "loop_closures": 0,
        "lrf_on_s": 3.0,
        "ins_ms_total": 1.0,
        "wall_time_s": 0.5,
        "peak_rss_mb": 80.0,
        "slam_ms": [1.0, 2.0, 9.0],
    }
    return RunResult(**(values | changes))


def test_every_file_is_there_and_tells_the_same(tmp_path):
    summary = run_directory.write_run(tmp_path, result())
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        ["map.png", "map.pgm", "map.yaml", "trajectory.tum", "graph.json", "summary.json"]
    )
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert set(summary) >= REQUIRED
    assert summary["slam_ms_median"] == 2.0
    assert summary["path_length_m"] == 1.0
    with Image.open(tmp_path / "map.png") as image:
        image.load()
    saved = read_map((tmp_path / "map.pgm").read_bytes(), (tmp_path / "map.yaml").read_text())
    assert saved.is_free.sum() == 600
    assert (
        json.loads((tmp_path / "graph.json").read_text())["nodes"][0]["gaps"][0]["width_m"]
        is None
    )


def test_the_trajectory_keeps_stamps_and_poses(tmp_path):
    given = result()
    run_directory.write_run(tmp_path, given)
    first = (tmp_path / "trajectory.tum").read_text().splitlines()[0].split()
    assert len(first) == 8
    assert first[0] == "976052857.337486"
    stamps_s, poses = run_directory.read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_allclose(stamps_s, given.stamps_s, atol=1e-6)
    np.testing.assert_allclose(poses, given.map_from_base, atol=1e-6)


def test_the_truth_is_written_in_simulation_only(tmp_path):
    run_directory.write_run(tmp_path, result())
    assert not (tmp_path / "truth.tum").exists()
    given = result(
        true_map_from_base=result().map_from_base,
        truth_metrics={"coverage": 0.99, "collisions": 0},
    )
    assert run_directory.write_run(tmp_path, given)["coverage"] == 0.99
    assert (tmp_path / "truth.tum").read_text() == (tmp_path / "trajectory.tum").read_text()


def test_a_run_that_saw_nothing_leaves_its_files_too(tmp_path):
    nothing = np.zeros((4, 4), dtype=bool)
    grid = TernaryMap(resolution_m=0.1, origin_m=(0, 0), is_occupied=nothing, is_free=nothing)
    given = result(
        grid=grid,
        stamps_s=np.zeros(0),
        map_from_base=np.zeros((0, 3)),
        graph={"nodes": []},
        slam_ms=[],
        state=RunState.FAILED,
    )
    assert run_directory.write_run(tmp_path, given)["slam_ms_p95"] == 0.0


def test_the_same_run_leaves_the_same_bytes(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        run_directory.write_run(tmp_path / name, result())
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_a_write_that_fails_leaves_the_old_file_and_no_rest(tmp_path, monkeypatch):
    path = tmp_path / "summary.json"
    run_directory.write_atomically(path, b"old")

    def full_disk(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(run_directory.os, "fsync", full_disk)
    with pytest.raises(InputError, match="No space left"):
        run_directory.write_atomically(path, b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]
    assert path.read_bytes() == b"old"


def test_an_out_that_is_a_file_is_refused_before_the_work(tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    for path in (file, file / "below"):
        with pytest.raises(InputError, match="not a directory"):
            run_directory.prepare_directory(path)
    run_directory.prepare_directory(tmp_path / "new" / "deep")
    assert list((tmp_path / "new" / "deep").iterdir()) == []


def test_an_out_may_hold_a_run_of_ours_and_nothing_else(tmp_path):
    assert not run_directory.prepare_directory(tmp_path / "new")
    run_directory.write_run(tmp_path / "new", result())
    (tmp_path / "new" / "truth.tum").write_text("of the run before")
    assert run_directory.prepare_directory(tmp_path / "new")
    assert not (tmp_path / "new" / "summary.json").exists()
    assert not (tmp_path / "new" / "truth.tum").exists()
    with pytest.raises(InputError, match="no run of ours; name a new directory"):
        run_directory.prepare_directory(tmp_path)


@pytest.mark.parametrize(("scans", "says"), [(0, "0 scans,"), (1, "1 scan,"), (7, "7 scans,")])
def test_the_caption_counts_as_people_do(scans, says):
    assert says in run_directory.picture_of(result(scans=scans)).caption
