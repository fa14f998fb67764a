# SPDX-License-Identifier: MIT
"""`ins-robot localize` on a map and a log written here, and what it refuses."""

import json
import math

import numpy as np
import pytest
from walled_map import hall, map_of, room, scan_in

from ins_robot.cli.main import main
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.logs.scan_source import open_scans, spaced
from ins_robot.mapping.map_files import pgm_bytes, yaml_text

LASER_FOV_DEG = "360"


def write_map(directory, world):
    directory.mkdir()
    grid = map_of(world)
    (directory / "map.pgm").write_bytes(pgm_bytes(grid))
    (directory / "map.yaml").write_text(yaml_text(grid, "map.pgm"))
    return directory


def write_log(path, world, start, steps=12):
    """A CARMEN log of an all-round laser on a robot that drives an arc; its true poses."""
    rng = np.random.default_rng(1)
    pose, odom, lines, poses = start, Pose2(), [], []
    for k in range(steps):
        step = Pose2(0.11, 0.0, 0.05) if k else Pose2()
        pose, odom = pose @ step, odom @ step
        scan = scan_in(world, pose, rng)
        words = " ".join(f"{r:.3f}" for r in np.nan_to_num(scan.ranges_m, nan=81.9))
        at = f"{odom.x_m:.6f} {odom.y_m:.6f} {odom.heading_rad:.6f}"
        lines.append(f"FLASER 180 {words} {at} {at} {100.0 + k:.6f} x {100.0 + k:.6f}")
        poses.append(pose.as_array())
    path.write_text("\n".join(lines) + "\n")
    return np.array(poses)


def localize(*words):
    return main(["localize", *map(str, words), "--fov", LASER_FOV_DEG])


@pytest.mark.parametrize("given", ["", "map.yaml"])
def test_a_run_directory_or_a_yaml_file_and_the_pose_at_the_last_scan_used(
    tmp_path, capsys, given
):
    world = room()
    poses = write_log(tmp_path / "log.clf", world, Pose2(1.2, 1.0, 0.3))
    directory = write_map(tmp_path / "run", world)
    assert localize(directory / given, tmp_path / "log.clf", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["verdict"], report["scans"]) == ("located", 2)
    truth = poses[round(report["stamp_s"] - 100.0)]
    assert math.hypot(report["x_m"] - truth[0], report["y_m"] - truth[1]) < 0.05
    assert report["heading_deg"] == pytest.approx(math.degrees(truth[2]), abs=1.5)
    assert np.array(report["covariance"]).shape == (3, 3)


def test_ambiguous_and_lost_have_exit_codes_of_their_own(tmp_path, capsys):
    twin = hall(4.6, 3.8)
    write_log(tmp_path / "hall.clf", twin, Pose2(1.2, 1.0, 0.3))
    assert localize(write_map(tmp_path / "hall", twin), tmp_path / "hall.clf") == 3
    words = capsys.readouterr().out.split("\n")
    assert words[0].startswith("ambiguous after")
    assert [line.split()[0] for line in words[1:3]] == ["x", "x"]
    small = write_map(tmp_path / "small", hall(1.8, 1.6))
    assert localize(small, tmp_path / "hall.clf", "--scans", "3") == 4
    assert capsys.readouterr().out.startswith("lost after 3 scans")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda run: (run / "map.yaml").unlink(), "no such map"),
        (lambda run: (run / "map.pgm").unlink(), "image cannot be read"),
        (lambda run: (run / "map.yaml").write_bytes(b"\xff\xfe"), "not text"),
        (lambda run: (run / "map.pgm").write_bytes(b"P5\n92 76\n255\nxy"), "cut off"),
        (
            lambda run: (run / "map.pgm").write_bytes(b"P5\n3 3\n255\n" + b"\xfe" * 9),
            "no occupied cell",
        ),
    ],
)
def test_a_map_that_cannot_be_used_is_one_line(tmp_path, capsys, spoil, words):
    run = write_map(tmp_path / "run", room())
    write_log(tmp_path / "log.clf", room(), Pose2(1.2, 1.0, 0.3), steps=1)
    spoil(run)
    assert localize(run, tmp_path / "log.clf") == 1
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_scans_skipped_beyond_the_end_are_said(tmp_path, capsys):
    run = write_map(tmp_path / "run", room())
    write_log(tmp_path / "log.clf", room(), Pose2(1.2, 1.0, 0.3), steps=3)
    assert localize(run, tmp_path / "log.clf", "--skip", "3") == 1
    assert "no scan after the first 3" in capsys.readouterr().err


def test_spaced_scans_carry_the_whole_motion_between_them(tmp_path):
    poses = write_log(tmp_path / "log.clf", room(), Pose2(1.2, 1.0, 0.3))
    rng = np.random.default_rng(0)
    every = list(open_scans(tmp_path / "log.clf", rng, 360.0).steps)
    some = list(spaced(iter(every), spacing_m=0.3, turn_rad=1.0))
    assert (len(every), len(some)) == (12, 4)
    rows = [round(scan.stamp_s - 100.0) for scan, _ in some]
    assert rows == [0, 3, 6, 9]
    for (_, motion), before, after in zip(some[1:], rows, rows[1:], strict=False):
        np.testing.assert_allclose(
            motion.delta.as_array(), between(poses[before], poses[after]), atol=1e-4
        )
        assert motion.covariance[0, 0] > every[1][1].covariance[0, 0]
