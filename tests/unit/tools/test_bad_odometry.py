# SPDX-License-Identifier: MIT
"""Odometry is made as bad as told, and what is scored does not hang on where the map lies."""

from pathlib import Path

import numpy as np
import pytest
from bad_odometry import COLUMNS, Grade, Job, line, run, seen_again, with_bad_odometry

from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import between, compose

EXACT = Grade("exact", 0.0, 0.0, 0.0)
ROUNDS = 3


def circles(count=60):
    turn = np.arange(ROUNDS * count) * 2.0 * np.pi / count
    return np.column_stack([3.0 * np.cos(turn), 3.0 * np.sin(turn), wrap_rad(turn + 1.6)])


def test_exact_odometry_leads_along_the_poses():
    poses = circles()
    led = with_bad_odometry(poses, EXACT, np.random.default_rng(0))
    np.testing.assert_allclose(compose(poses[0], led)[:, :2], poses[:, :2], atol=1e-9)


@pytest.mark.parametrize("along", [0.05, 0.2])
def test_it_errs_by_as_much_as_its_grade_says(along):
    poses = np.column_stack([np.arange(5000) * 0.5, np.zeros((5000, 2))])
    led = with_bad_odometry(poses, Grade("g", along, 0.0, 0.0), np.random.default_rng(1))
    off = between(led[:-1], led[1:])[:, 0] - 0.5
    assert off.std() == pytest.approx(along * np.sqrt(0.5), rel=0.05)


def test_what_is_scored_is_how_places_lie_to_one_another():
    poses = circles()
    moved = compose(np.array([5.0, -2.0, 1.0]), poses)
    assert seen_again(poses, moved)[0].max() < 1e-9
    torn = poses.copy()
    torn[60:] += [0.3, 0.0, 0.0]
    off_m, _ = seen_again(poses, torn)
    assert off_m.max() == pytest.approx(0.3)
    assert len(off_m) > 100


def test_a_log_is_replayed_and_told_in_one_line(tmp_path: Path):
    poses, bearings = circles(40), np.radians(np.arange(181.0) - 90.0)
    rows = []
    for k, (x, y, heading) in enumerate(poses):
        toward = heading + bearings
        with np.errstate(divide="ignore"):
            ranges = np.minimum(
                (np.sign(np.cos(toward)) * 5.0 - x) / np.cos(toward),
                (np.sign(np.sin(toward)) * 4.0 - y) / np.sin(toward),
            )
        told = " ".join(f"{r:.3f}" for r in ranges)
        pose = f"{x:.6f} {y:.6f} {heading:.6f}"
        rows.append(f"FLASER 181 {told} {pose} {pose} {k}.0 nobody {k}.0")
    (tmp_path / "hall.log").write_text("\n".join(rows) + "\n")
    job = Job(tmp_path / "hall.log", True, Grade("fair", 0.04, 0.03, 0.1), 1, tmp_path / "out")
    scans, off_m, off_deg = run(job)
    assert (scans, len(off_m)) == (len(poses), len(off_deg))
    assert off_m.mean() < 0.1
    told = line(job, [(scans, off_m, off_deg)])
    assert "| hall | as an XV-11 | fair | 120 |" in told
    assert told.count("|") == len(COLUMNS) + 1
    assert (tmp_path / "out" / job.name / "map.png").is_file()
