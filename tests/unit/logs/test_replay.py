# SPDX-License-Identifier: MIT
"""Replay of a small log written here: a robot that circles in a room with worn wheels."""

import json
import math
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ins_robot.cli.commands.replay import ProgressLine
from ins_robot.cli.main import main
from ins_robot.config import Config
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs import run_directory
from ins_robot.logs.carmen import read_carmen
from ins_robot.logs.replay import replay_log
from ins_robot.logs.run_directory import read_tum, write_run

WALLS = ((-2.0, 3.0), (-1.5, 2.5))
BOX = ((1.2, 1.8), (1.0, 1.6))
WHEELS = 1.05  # what the odometry makes of a metre


def ranges_from(pose):
    bearings = pose.heading_rad + np.radians(np.arange(-90, 90))
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    start = np.array([pose.x_m, pose.y_m])
    with np.errstate(divide="ignore"):
        walls = (np.where(directions > 0, *np.array(WALLS).T[::-1, None]) - start) / directions
        sides = (np.array(BOX).T[:, None] - start) / directions
    enter, leave = np.sort(sides, axis=0)
    hits_box = (enter.max(axis=-1) < leave.min(axis=-1)) & (enter.max(axis=-1) > 0)
    return np.where(hits_box, enter.max(axis=-1), walls.min(axis=-1))


def drive():
    """True and odometry poses of 240 records, every fourth a scan."""
    truth, odometry = [Pose2()], [Pose2()]
    for i in range(239):
        step = Pose2() if i < 8 else Pose2(0.025, 0.0, 0.02)
        worn = Pose2(step.x_m * WHEELS, 0.0, step.heading_rad * 0.97)
        truth.append(truth[-1] @ step)
        odometry.append(odometry[-1] @ worn)
    return truth, odometry


def write_log(path):
    rng = np.random.default_rng(1)
    truth, odometry = drive()
    lines = []
    for i, (true, odom) in enumerate(zip(truth, odometry, strict=True)):
        pose = f"{odom.x_m:.6f} {odom.y_m:.6f} {odom.heading_rad:.6f}"
        stamp = 976052857.0 + 0.2 * i
        if i % 4:
            lines.append(f"ODOM {pose} 0 0 0 {stamp:.6f} x {stamp:.6f}")
        else:
            ranges = ranges_from(true) + rng.normal(0.0, 0.01, 180)
            words = " ".join(f"{r:.2f}" for r in ranges)
            lines.append(f"FLASER 180 {words} {pose} {pose} {stamp:.6f} x {stamp:.6f}")
    path.write_text("\n".join(lines) + "\n")
    return np.array([p.as_array() for p in truth])


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "room.clf"
    return path, write_log(path)


def errors(poses, truth):
    off = poses - truth
    return np.hypot(off[:, 0], off[:, 1]).max(), np.abs(wrap_rad(off[:, 2])).max()


def test_slam_corrects_the_whole_past_and_writes_every_record(log, tmp_path, capsys):
    path, truth = log
    assert main(["replay", str(path), "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["state"], summary["scans"]) == ("complete", 60)
    stamps_s, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(stamps_s, 976052857.0 + 0.2 * np.arange(240), atol=1e-6)
    off_m, off_rad = errors(poses, truth)
    assert off_m < 0.06
    assert off_rad < 0.03
    graph = json.loads((tmp_path / "out" / "graph.json").read_text())
    assert len(graph["nodes"]) == summary["nodes"]
    assert graph["nodes"][0]["neighbours"] == [1]


def test_odometry_alone_gives_the_odometry(log, tmp_path, capsys):
    path, truth = log
    arguments = ["--set", "slam.estimator=odometry", "--out", str(tmp_path)]
    assert main(["replay", str(path), *arguments]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'map.png'}\n"
    _, poses = read_tum(tmp_path / "trajectory.tum")
    expected = np.array([p.as_array() for p in drive()[1]])
    assert errors(poses, expected)[0] < 1e-3
    assert errors(poses, truth)[0] > 0.2


def test_without_odometry_the_scans_tell_the_way(log, tmp_path):
    path, truth = log
    assert main(["replay", str(path), "--no-odometry", "--out", str(tmp_path)]) == 0
    _, poses = read_tum(tmp_path / "trajectory.tum")
    off_m, off_rad = errors(poses, truth)
    assert off_m < 0.1
    assert off_rad < 0.08


def test_every_third_scan_keeps_all_records(log, tmp_path, capsys):
    path, truth = log
    arguments = ["--every", "3", "--json", "--out", str(tmp_path)]
    assert main(["replay", str(path), *arguments]) == 0
    assert json.loads(capsys.readouterr().out)["scans"] == 20
    stamps_s, poses = read_tum(tmp_path / "trajectory.tum")
    assert len(stamps_s) == 240
    assert errors(poses, truth)[0] < 0.08


def replayed(path, seed=0):
    told = []
    result = replay_log(
        read_carmen(path),
        Config(),
        "room",
        np.random.default_rng(seed),
        lambda: 0.0,
        told.append,
    )
    return result, told


def test_the_same_seed_gives_the_same_bytes_and_progress_ends_at_one(log):
    (first, told), (second, _) = replayed(log[0]), replayed(log[0])
    assert first.map_from_base.tobytes() == second.map_from_base.tobytes()
    assert np.array_equal(first.grid.log_odds, second.grid.log_odds)
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0, abs=0.02)
    assert math.isclose(first.duration_s, 0.2 * 239, abs_tol=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [("", "empty"), ("nonsense\n", "not a log"), ("FLASER 180 1.0\n", ":1: FLASER of 180")],
)
def test_a_bad_log_is_one_line_and_leaves_nothing(tmp_path, capsys, content, words):
    path = tmp_path / "bad.clf"
    path.write_text(content)
    assert main(["replay", str(path), "--out", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert words in captured.err
    assert not (tmp_path / "out").exists()


def test_a_bad_option_is_refused(log, tmp_path, capsys):
    path = str(log[0])
    assert main(["replay", path, "--out", str(tmp_path), "--set", "slam.particels=3"]) == 1
    assert "did you mean 'particles'" in capsys.readouterr().err
    for option in (["--every", "0"], ["--every", "x"], ["--fov", "400"]):
        with pytest.raises(SystemExit) as caught:
            main(["replay", path, "--out", str(tmp_path), *option])
        assert caught.value.code == 2


def test_replay_of_a_log_needs_neither_filterpy_nor_matplotlib(log, tmp_path):
    words = ["replay", str(log[0]), "--every", "6", "--out", str(tmp_path)]
    code = (
        "import sys; from ins_robot.cli.main import main; "
        f"assert main({words!r}) == 0; "
        "heavy = {'filterpy', 'matplotlib', 'scipy.stats', 'serial', 'smbus2', 'asyncio'}; "
        "heavy &= set(sys.modules); "
        "assert not heavy, heavy"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()) == tmp_path / "map.png"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_replay_that_is_interrupted_keeps_what_it_has(
    log, tmp_path, monkeypatch, capsys, number
):
    def show(meter, share):
        if share > 0.5:
            signal.raise_signal(number)

    monkeypatch.setattr(ProgressLine, "show", show)
    out = tmp_path / "out"
    assert main(["replay", str(log[0]), "--out", str(out)]) == 130
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith("stopped: interrupted at 50%; ")
    assert told[1:] == [f"interrupted; what was computed so far is in {out}"]
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["state"], summary["reason"]) == ("stopped", "interrupted at 50%")
    assert len(read_tum(out / "trajectory.tum")[0]) == 121
    assert signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)


@pytest.mark.parametrize("moment", ["in the last scan", "while saving"])
def test_an_interrupt_that_cuts_nothing_short_is_none(
    log, tmp_path, monkeypatch, capsys, moment
):
    def show(meter, share):
        if share > 0.98 and moment == "in the last scan":
            signal.raise_signal(signal.SIGINT)

    def save(*what):
        if moment == "while saving":
            signal.raise_signal(signal.SIGINT)
        return write_run(*what)

    monkeypatch.setattr(ProgressLine, "show", show)
    monkeypatch.setattr(run_directory, "write_run", save)
    out = tmp_path / "out"
    assert main(["replay", str(log[0]), "--out", str(out)]) == 0
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith("complete: end of the CARMEN log; ")
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["state"], summary["reason"]) == ("complete", "end of the CARMEN log")
    assert len(read_tum(out / "trajectory.tum")[0]) == 240


def test_a_replay_says_what_it_replaces_and_spares_a_recording(log, tmp_path, capsys):
    words = ["replay", str(log[0]), "--every", "30", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert capsys.readouterr().err.startswith("complete: end of the CARMEN log; ")
    assert main(words) == 0
    told = capsys.readouterr().err.splitlines()
    assert told[0] == f"{tmp_path / 'out'}: replaces the run there"
    (tmp_path / "out" / "run.journal").write_bytes(b"a recording")
    assert main(words) == 1
    assert "a recorded run is there" in capsys.readouterr().err
