# SPDX-License-Identifier: MIT
"""CARMEN logs: what each kind of line means, and what is said of lines that are wrong."""

import math

import numpy as np
import pytest

from ins_robot.errors import InputError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.carmen import read_carmen
from ins_robot.logs.sensor_log import beam_bearings_rad


def flaser(ranges, laser="0 0 0", odom="0 0 0", time="10.5"):
    words = " ".join(str(r) for r in ranges)
    return f"FLASER {len(ranges)} {words} {laser} {odom} {time} host 99.0"


def odom(x=0.0, y=0.0, heading=0.0, time=10.0):
    return f"ODOM {x} {y} {heading} 0.1 0.2 0 {time} host 99.0"


@pytest.fixture
def log(tmp_path):
    def write(*lines, end="\n"):
        path = tmp_path / "log.clf"
        path.write_text("\n".join(lines) + end)
        return path

    return write


def test_records_come_in_the_order_of_lines_with_their_own_stamps(log):
    read = read_carmen(log(odom(time=5.0), flaser([1.0] * 4, time="4.5"), odom(1.0, time=4.75)))
    assert [r.stamp_s for r in read.records] == [5.0, 4.5, 4.75]
    assert [r.scan is not None for r in read.records] == [False, True, False]
    assert read.records[1].scan.stamp_s == 4.5
    assert read.records[2].odom_from_base == Pose2(1.0, 0.0, 0.0)
    assert read.scan_count == 1


@pytest.mark.parametrize(
    ("beams", "last_deg", "step_deg"),
    [(180, 89.0, 1.0), (181, 90.0, 1.0), (360, 89.5, 0.5), (361, 90.0, 0.5), (90, 88.0, 2.0)],
)
def test_beams_span_half_a_turn_from_right_to_left(log, beams, last_deg, step_deg):
    scan = read_carmen(log(flaser([1.0] * beams))).records[0].scan
    bearings_deg = np.degrees(scan.bearings_rad)
    assert bearings_deg[0] == -90.0
    assert bearings_deg[-1] == pytest.approx(last_deg)
    np.testing.assert_allclose(np.diff(bearings_deg), step_deg)


def test_another_span_can_be_told(log):
    scan = read_carmen(log(flaser([1.0] * 541)), math.radians(270.0)).records[0].scan
    assert np.degrees(scan.bearings_rad[[0, 270, -1]]) == pytest.approx([-135.0, 0.0, 135.0])


def test_bearings_of_one_beam_and_none_are_finite():
    assert np.isfinite(beam_bearings_rad(1)).all()
    assert len(beam_bearings_rad(0)) == 0


def test_far_zero_and_odd_ranges_are_no_reading(log):
    path = log(flaser([1.0, 81.83, 80.0, 79.9, 0.0, -1.0, "nan", "inf"]))
    scan = read_carmen(path).records[0].scan
    assert scan.is_valid.tolist() == [True, False, False, True, False, False, False, False]
    assert np.isfinite(scan.range_std_m).tolist() == scan.is_valid.tolist()
    assert not scan.is_free_when_silent


def test_the_lasers_place_is_read_from_the_two_poses(log):
    lines = []
    for i in range(5):
        base = Pose2(0.3 * i, 0.1 * i, 0.4 * i)
        laser = base @ Pose2(0.12, -0.03, 0.05)
        words = [" ".join(str(float(v)) for v in p.as_array()) for p in (laser, base)]
        lines.append(flaser([1.0] * 3, *words))
    read = read_carmen(log(*lines))
    assert read.base_from_lrf.as_array() == pytest.approx([0.12, -0.03, 0.05], abs=1e-4)


def test_corrected_poses_in_the_lasers_place_are_not_a_mounting(log):
    lines = [flaser([1.0] * 3, f"{0.1 * i * i} 0 0", f"{0.3 * i} 0 0") for i in range(8)]
    assert read_carmen(log(*lines)).base_from_lrf == Pose2()


ROBOTLASER = (
    "ROBOTLASER1 0 -1.570796 3.141593 0.785398 30.0 0.01 0 4 1.0 2.0 31.0 4.0 {} "
    "1.2 0 0 1.0 0 0 0.1 0.2 0 0 0 7.25 host 99.0"
)


@pytest.mark.parametrize("remissions", ["0", "2 0.5 0.5"])
def test_robotlaser_lines_bring_their_own_geometry(log, remissions):
    read = read_carmen(log(ROBOTLASER.format(remissions)))
    scan = read.records[0].scan
    assert scan.stamp_s == 7.25
    assert np.degrees(scan.bearings_rad) == pytest.approx([-90, -45, 0, 45], abs=1e-3)
    assert scan.is_valid.tolist() == [True, True, False, True]
    assert read.records[0].odom_from_base == Pose2(1.0)
    assert read.base_from_lrf == Pose2(0.2)


def test_a_scan_logged_in_two_kinds_counts_once(log):
    read = read_carmen(log(flaser([1.0] * 4), ROBOTLASER.format("0"), flaser([1.0] * 4)))
    assert [len(r.scan.ranges_m) for r in read.records] == [4, 4]
    assert [r.stamp_s for r in read.records] == [10.5, 10.5]


def test_other_lines_are_passed_over(log):
    others = (
        "# comment",
        "PARAM robot_width 0.5 0 host 0",
        "SYNC tag 1 host 1",
        "",
        "   ",
        "RLASER 1 5.0 0 0 0 0 0 0 1 host 1",
        "TRUEPOS 1 2 3 4 5 6 7 host 1",
    )
    assert len(read_carmen(log(*others, flaser([1.0] * 4), odom())).records) == 2


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("FLASER", ":2: FLASER has 1 words"),
        ("FLASER x 1 2", ":2: the number of beams is 'x'"),
        ("FLASER 99999999 1", "must be 1 to 10000"),
        ("FLASER -3 1", "must be 1"),
        ("FLASER 180 1.0 2.0", ":2: FLASER of 180 beams has 4 words, needs 189"),
        (flaser(["a", 1.0]), ":2: 'a' is not a number"),
        (flaser([1.0], odom="0 nan 0"), "pose is not finite"),
        (flaser([1.0], time="inf"), "the time is inf"),
        ("ODOM 1 2", ":2: ODOM has 3 words"),
        ("ODOM 1 2 x 0 0 0 5 host 1", "'x' is not a number"),
        ("ROBOTLASER1 0 1", "ROBOTLASER1 has 3 words"),
        ("ROBOTLASER1 0 0 3 0.1 30 0 0 1 5.0 oops", "number of remissions is 'oops'"),
        ("\udcff".encode("utf-8", "surrogateescape").decode("latin-1"), None),
    ],
)
def test_a_wrong_line_is_named(log, line, words):
    path = log(odom(), line)
    if words is None:
        path.write_bytes(path.read_bytes() + b"\xff\xfe\n")
        words = "not text"
    with pytest.raises(InputError, match=words) as caught:
        read_carmen(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_cut_log_is_refused_wherever_it_was_cut(log):
    whole = flaser([1.0] * 4) + "\n" + flaser([2.25] * 4)
    start = whole.index("\n") + 1
    for size in range(start + 1, len(whole) - 4):  # the last time stamp is not used
        path = log(whole[:size], end="")
        with pytest.raises(InputError, match=r":2: "):
            read_carmen(path)
    assert read_carmen(log(whole, end="")).scan_count == 2


def test_a_log_without_scans_is_refused(log):
    with pytest.raises(InputError, match="no FLASER"):
        read_carmen(log(odom()))
