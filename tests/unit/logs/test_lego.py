# SPDX-License-Identifier: MIT
"""The LEGO robot's directory: wheels, units, beams, and wrong lines."""

import math

import numpy as np
import pytest

from ins_robot.errors import InputError
from ins_robot.logs.lego import (
    AXLE_FROM_MARK,
    METRES_PER_TICK,
    MOTOR_DELAY_S,
    RANGE_OFFSET_M,
    RANGE_SCALE,
    SCAN_DELAY_S,
    TRACK_M,
    drive,
    read_lego,
)

BEAMS = 660


def motors(times_ms, left, right):
    return [
        f"M {t} {a} 0 0 0 {b} 0 0 0 0 0 0 0".replace(f"0 0 0 {b}", f"{a} 3000 0 {b}")
        for t, a, b in zip(times_ms, left, right, strict=True)
    ]


@pytest.fixture
def directory(tmp_path):
    def write(motor_lines, scan_lines, end="\n"):
        (tmp_path / "some_motors.txt").write_text("\n".join(motor_lines) + "\n")
        (tmp_path / "any.txt").write_text("\n".join(scan_lines) + end)
        (tmp_path / "reference.txt").write_text("P 378 1850 1897\n")
        (tmp_path / "readme.txt").write_text("About this robot\nM is for motor\n")
        return tmp_path

    return write


def test_equal_ticks_drive_straight():
    poses = drive(np.array([[0, 0], [1000, 1000]]))
    assert poses[-1] == pytest.approx([1000 * METRES_PER_TICK, 0.0, 0.0])


def test_opposite_ticks_turn_on_the_spot():
    quarter = 0.25 * math.pi * TRACK_M / METRES_PER_TICK
    turned = drive(np.array([[0, 0], [-quarter, quarter]]))[-1]
    assert turned[2] == pytest.approx(math.pi / 2)


def test_many_small_arcs_make_the_same_circle_as_one_large():
    ticks = np.array([[0.0, 0.0], [900.0, 1700.0]])
    fine = np.linspace(ticks[0], ticks[1], 1000)
    np.testing.assert_allclose(drive(fine)[-1], drive(ticks)[-1], atol=1e-6)


def test_the_mark_ahead_of_the_axle_swings_out_in_a_turn_on_the_spot():
    quarter = 0.25 * math.pi * TRACK_M / METRES_PER_TICK
    ahead_m = AXLE_FROM_MARK.x_m
    assert drive(np.array([[0, 0], [-quarter, quarter]]))[-1] == pytest.approx(
        [-ahead_m, ahead_m, math.pi / 2]
    )


def test_scans_stand_among_the_motor_lines_in_metres(directory):
    read = read_lego(
        directory(
            motors([0, 1000, 2000], [5000, 5000, 6000], [700, 700, 1700]),
            [f"S 1750 {BEAMS} " + " ".join(["1500"] * 330 + ["15"] + ["1800"] * 329)],
        )
    )
    stamps_s = np.array([0.0, 1.0, 1.5, 2.0]) + MOTOR_DELAY_S
    assert [r.stamp_s for r in read.records] == pytest.approx(stamps_s)
    record = read.records[2]
    assert record.odom_from_base.x_m == pytest.approx(500 * METRES_PER_TICK)
    assert record.scan.is_valid.sum() == BEAMS - 1
    # Taken earlier, further back, the walls ahead look nearer now.
    ahead = np.nanargmin(np.abs(record.scan.bearings_rad + read.base_from_lrf.heading_rad))
    driven_since_m = 1000 * SCAN_DELAY_S * METRES_PER_TICK
    wall_m = 1.8 * RANGE_SCALE + RANGE_OFFSET_M
    assert record.scan.ranges_m[ahead] == pytest.approx(wall_m - driven_since_m, abs=0.002)


def test_later_beams_are_turned_on_with_the_robot(directory):
    ticks = 0.5 * TRACK_M / METRES_PER_TICK * np.arange(5)
    read = read_lego(
        directory(
            motors(range(0, 5000, 1000), -ticks, ticks),
            [f"S 2000 {BEAMS} " + " ".join(["1500"] * BEAMS)],
        )
    )
    (bearings_rad,) = [r.scan.bearings_rad for r in read.records if r.scan is not None]
    # At 1 rad/s a sweep of 0.1 s a turn sees the step from beam to beam widened by 0.1 / 2 pi.
    widened = 1.0 + 0.1 / math.tau
    assert np.ptp(np.unwrap(bearings_rad)) == pytest.approx(
        widened * (BEAMS - 1) * math.tau / 1000, rel=2e-3
    )


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        ("S 5", r"any.txt:2: S has 2 words"),
        ("S 5 660 1 2 3", r"any.txt:2: S of 660 beams has 6 words"),
        ("S 5 0", "the number of beams is '0'"),
        ("S x 1 5", "'x' is not a number"),
    ],
)
def test_a_wrong_scan_is_named(directory, scan, words):
    good = "S 5 2 1000 1000"
    with pytest.raises(InputError, match=words):
        read_lego(directory(motors([0, 1000], [0, 1], [0, 1]), [good, scan]))


def test_a_wrong_motor_line_is_named(directory):
    with pytest.raises(InputError, match=r"some_motors.txt:2: the time goes back"):
        read_lego(directory(motors([10, 5], [0, 1], [0, 1]), ["S 5 1 1000"]))
    with pytest.raises(InputError, match=r"some_motors.txt:2: M has 3 words"):
        read_lego(directory([*motors([10], [0], [0]), "M 20 5"], ["S 5 1 1000"]))


@pytest.mark.parametrize("missing", ["scans", "motor"])
def test_a_directory_without_scans_or_motors_is_refused(directory, missing):
    motor_lines = [] if missing == "motor" else motors([0, 1], [0, 0], [0, 0])
    scan_lines = [] if missing == "scans" else ["S 5 1 1000"]
    with pytest.raises(InputError, match=f"no lines with {missing}"):
        read_lego(directory(motor_lines, scan_lines))
