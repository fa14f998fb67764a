# SPDX-License-Identifier: MIT
"""What a survey says of its end, and of what is in the way."""

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.core.survey import Survey
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan, MotionIncrement, PlannedPath
from ins_robot.navigation.decisions import NO_GAP, Drive, Finished


def test_a_run_sent_somewhere_at_its_end_has_not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    survey = Survey(Config(), np.random.default_rng(0), lambda: 0.0)
    path = PlannedPath(points_m=np.zeros((2, 2)), headings_rad=np.zeros(2))
    drive = Drive(path=path, node_id=0, gap_id=NO_GAP, reason="goto")
    monkeypatch.setattr(survey.explorer, "send_to", lambda *asked: drive)
    survey.ended = Finished(reason="no reachable gap is left", left=())
    assert survey.send_to((1.0, 0.0), Pose2()) is drive
    assert survey.ended is None


def scan_of_a_room(half_m: float, **nearer_m: float) -> LaserScan:
    """360 beams in the middle of a square room; `b90 = 0.3`: what a beam reads instead."""
    bearings = np.radians(np.arange(-180.0, 180.0))
    ranges = half_m / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    for beam, range_m in nearer_m.items():
        ranges[180 + int(beam[1:])] = range_m
    return LaserScan(
        stamp_s=0.0,
        bearings_rad=bearings,
        ranges_m=ranges,
        range_std_m=np.full(360, 0.002),
        beam_offsets_s=np.zeros(360),
        range_max_m=6.0,
        valid_counts=np.ones(360, np.int64),
    )


def room_round_the_robot(*scans: LaserScan) -> float:
    """Distance to the nearest obstacle after scans from one place."""
    survey = Survey(Config(), np.random.default_rng(0), lambda: 0.0)
    still = MotionIncrement(
        from_stamp_s=0.0, to_stamp_s=0.0, delta=Pose2(), covariance=np.diag([1e-8] * 3)
    )
    for scan in scans:
        survey.scan_on_the_way(scan, still)
    here = survey.slam.pose
    lrf = here @ Pose2(Config().lrf.x_m, Config().lrf.y_m, 0.0)
    return float(survey.obstacles(here).query((lrf.x_m, lrf.y_m))[0])


def test_a_wall_is_where_the_last_scan_saw_it_when_the_map_has_it_farther() -> None:
    wide, bump = scan_of_a_room(0.5), {f"b{beam}": 0.488 for beam in range(-4, 5)}
    assert room_round_the_robot(wide) == pytest.approx(0.5, abs=0.002)
    assert room_round_the_robot(wide, scan_of_a_room(0.5, **bump)) == pytest.approx(
        0.488, abs=0.003
    )


def test_a_lone_reading_before_a_wall_and_one_in_the_open_stand_in_nobodys_way() -> None:
    wide = scan_of_a_room(0.5)
    for lone in ({"b0": 0.48}, {f"b{beam}": 0.4 for beam in range(-4, 5)}):
        assert room_round_the_robot(wide, scan_of_a_room(0.5, **lone)) > 0.49
