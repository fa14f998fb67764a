# SPDX-License-Identifier: MIT
"""The exploration benchmark: its lines, its resuming, its yardsticks."""

import json
from pathlib import Path

import benchmark_exploration
import numpy as np
import pytest
from exploration_study import jobs, report
from exploration_study.measure import measure_reference
from PIL import Image

DATA = Path(__file__).parents[4] / "shared" / "data" / "worlds"
KEYS = {
    "world", "start", "strategy", "mode", "pose", "seed", "l90_m", "l95_m", "l99_m", "coverage",
    "stops", "decisions", "time_s", "ms_per_decision", "home_m", "failure",
}  # fmt: skip


@pytest.fixture
def worlds(tmp_path):
    """Two rooms and a door, as a map_server world of 0.05 m."""
    is_free = np.zeros((80, 120), bool)
    is_free[5:75, 5:55] = is_free[5:75, 60:115] = is_free[30:50, 55:60] = True
    folder = tmp_path / "worlds"
    folder.mkdir()
    Image.fromarray(np.where(is_free, 254, 0).astype(np.uint8)).save(folder / "two.pgm")
    (folder / "two.yaml").write_text(
        "image: two.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (folder / "worlds.csv").write_text("name,start0_x_m,start0_y_m\ntwo,1.0,2.0\n")
    return folder


def run(worlds, out, *options):
    assert (
        benchmark_exploration.main(["--worlds", str(worlds), "--out", str(out), *options]) == 0
    )
    return [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]


def test_every_strategy_sees_two_rooms_under_the_reference_sensor(worlds, tmp_path):
    rows = run(worlds, tmp_path / "out", "--reference-sensor")
    assert len(rows) == 8 * 2
    for row in rows:
        assert row.keys() >= KEYS
        assert row["failure"] is None, row
        assert row["l90_m"] <= row["l95_m"] <= row["l99_m"]
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {
        "coverage_stop_perfect.png", "coverage_enroute_perfect.png",
    }  # fmt: skip


@pytest.mark.parametrize("pose", ["perfect", "estimated"])
@pytest.mark.parametrize("mode", ["stop", "enroute"])
def test_the_configured_sensor_to_its_own_stop(worlds, tmp_path, mode, pose):
    options = ["--strategies", "auto", "--modes", mode, "--poses", pose]
    (row,) = run(worlds, tmp_path / "out", *options)
    assert row["coverage"] >= 0.98
    assert row["contacts"] == 0
    assert row["home_m"] > 0.0


def test_a_finished_cell_is_not_run_again(worlds, tmp_path, monkeypatch):
    options = ["--strategies", "auto", "--modes", "stop", "--reference-sensor"]
    rows = run(worlds, tmp_path / "out", *options)
    file = tmp_path / "out" / "results.jsonl"
    file.write_text(file.read_text() + '{"world": "two", "cut o')  # an interruption

    def never(job):
        raise AssertionError(f"{job} was run again")

    monkeypatch.setattr(jobs, "measure", never)
    arguments = ["--worlds", str(worlds), "--out", str(tmp_path / "out"), *options]
    assert benchmark_exploration.main(arguments) == 0
    assert jobs.read_results(file).keys() == {rows[0]["key"]}


def test_a_pool_gives_the_same_lines(worlds, tmp_path):
    options = ["--strategies", "auto,nearest-frontier", "--modes", "stop", "--reference-sensor"]
    alone = run(worlds, tmp_path / "one", *options)
    pooled = run(worlds, tmp_path / "two", *options, "--jobs", "2")
    length = {row["strategy"]: row["l99_m"] for row in alone}
    assert {row["strategy"]: row["l99_m"] for row in pooled} == length


def test_a_dask_cluster_gives_the_same_lines(worlds, tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    options = ["--strategies", "auto,nearest-frontier", "--modes", "stop", "--reference-sensor"]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        rows = run(worlds, tmp_path / "out", *options, "--scheduler", address)
    assert {row["strategy"] for row in rows} == {"auto", "nearest-frontier"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--strategies", "best"], "--strategies best: unknown; one of min-gap"),
        (["--only", "atlantis"], "--only atlantis: unknown; one of two"),
        (["--starts", "3"], "two has starts 0 to 0"),
        (["--starts", "x"], "--starts x: not a number"),
        (["--seeds", "0"], "at least 1"),
        (["--poses", "estimated", "--reference-sensor"], "a perfect pose only"),
    ],
)
def test_what_cannot_be_run_is_said_in_one_line(worlds, tmp_path, options, said):
    with pytest.raises(SystemExit, match=said):
        run(worlds, tmp_path / "out", *options)


def test_the_ratio_counts_the_whole_way_of_a_run_that_missed(tmp_path):
    file = tmp_path / "reference.jsonl"
    file.write_text('{"alg": "offline99", "mode": "stop", "map": "w", "L99": 10.0}\n')
    reference = report.read_reference(tmp_path)
    row = {"world": "w", "start": 0, "mode": "stop", "l99_m": None, "path_m": 25.0}
    assert report.ratio_of(row, reference) == 2.5
    assert report.ratio_of(row | {"l99_m": 15.0}, reference) == 1.5
    assert report.ratio_of(row | {"start": 1}, reference) is None


@pytest.mark.parametrize(
    ("strategy", "name"), [("nearest-frontier", "nearest_recheck"), ("next-best-view", "nbv")]
)
def test_the_yardsticks_are_those_of_the_reference(strategy, name):
    if not DATA.exists():
        pytest.skip("../shared/data/worlds is not there")
    rows = [json.loads(line) for line in (DATA / "reference.jsonl").read_text().splitlines()]
    starts = jobs.read_starts(DATA)
    ours, theirs = [], []
    for world in ("house_b29eee73", "house_023add09", "house_65e6b828", "house_9413bdad"):
        track = measure_reference(DATA / f"{world}.yaml", starts[world][0], strategy, "stop")
        ours.append(track.marks[0.99][0])
        theirs += [
            r["L99"] for r in rows if (r["map"], r["alg"], r["mode"]) == (world, name, "stop")
        ]
    assert np.mean(ours) == pytest.approx(np.mean(theirs), rel=0.05)
