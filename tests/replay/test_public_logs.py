# SPDX-License-Identifier: MIT
"""What was really recorded is read as what it is. Needs ../shared/data, skips without it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.geometry import pose2
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.open_log import LogKind, find_log, read_log
from ins_robot.logs.replay import replay_log

DATA = Path(__file__).parents[3] / "shared" / "data"

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no public recordings in {DATA}")


def read(name):
    kind, path = find_log(DATA / name)
    return kind, read_log(kind, path)


@pytest.mark.parametrize(
    ("name", "kind", "records", "scans", "beams"),
    [
        ("slam/intel.clf", LogKind.CARMEN, 13_631, 2_726, 180),
        ("slam/fr079.clf", LogKind.CARMEN, 1_464, 1_464, 360),
        ("robot/botvac_driving_around.csv", LogKind.BOTVAC, 930, 465, 360),
        ("robot/botvac_rotating.csv", LogKind.BOTVAC, 700, 350, 360),
        ("robot/lego", LogKind.LEGO, 556, 278, 660),
    ],
)
def test_kind_and_size_are_as_told(name, kind, records, scans, beams):
    found, log = read(name)
    assert found is kind
    assert (len(log.records), log.scan_count) == (records, scans)
    assert {len(r.scan.ranges_m) for r in log.records if r.scan is not None} == {beams}


@pytest.mark.parametrize(
    ("name", "length_m", "share"),
    [
        ("slam/intel.clf", 508.4, 0.972),
        ("slam/intel_xv11.clf", 508.4, 0.439),
        ("robot/botvac_driving_around.csv", 22.9, 0.460),
        ("robot/lego", 9.08, 0.997),
    ],
)
def test_way_and_valid_share_are_as_measured(name, length_m, share):
    _, log = read(name)
    poses = np.array([r.odom_from_base.as_array() for r in log.records])
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() == pytest.approx(length_m, rel=0.01)
    valid = [r.scan.is_valid.mean() for r in log.records if r.scan is not None]
    assert np.mean(valid) == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(
    "name", ["robot/botvac_driving_around.csv", "robot/botvac_rotating.csv", "robot/lego"]
)
def test_neighbouring_scans_lie_on_one_another_by_odometry_alone(name):
    """Geometry, delays and signs are right where walls seen from many poses stay thin."""
    _, log = read(name)

    def filled_cells(base_from_lrf, turn):
        filled = 0
        scans = [r for r in log.records if r.scan is not None]
        for start in range(0, len(scans) - 12, 12):
            points = []
            for record in scans[start : start + 12]:
                odom = record.odom_from_base
                pose = Pose2(odom.x_m, odom.y_m, turn * odom.heading_rad) @ base_from_lrf
                points.append(pose.apply(record.scan.points_lrf_m()))
            filled += len(np.unique(np.floor(np.concatenate(points) / 0.04), axis=0))
        return filled

    as_read = filled_cells(log.base_from_lrf, 1.0)
    mounted = log.base_from_lrf
    assert as_read < 0.75 * filled_cells(mounted, -1.0)
    ahead = Pose2(mounted.x_m + 0.15, mounted.y_m, mounted.heading_rad)
    assert as_read < 0.99 * filled_cells(ahead, 1.0)


def test_scans_alone_tell_turns_of_more_than_a_right_angle():
    """Freiburg 079 turns by 54 and by 114 degrees between scans in its first 45 s."""
    _, log = read("slam/fr079.clf")
    first_s = log.records[0].stamp_s
    cut = replace(log, records=[r for r in log.records if r.stamp_s - first_s < 45.0])
    results = [
        replay_log(part, Config(), "fr079", np.random.default_rng(0), lambda: 0.0, print)
        for part in (cut, cut.without_odometry())
    ]
    off = pose2.between(*(result.map_from_base for result in results))
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.25
    assert np.abs(off[:, 2]).max() < 0.03
