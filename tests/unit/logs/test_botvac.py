# SPDX-License-Identifier: MIT
"""Botvac recordings, written here by a robot whose way is known."""

import math
import random

import numpy as np
import pytest

from ins_robot.errors import InputError
from ins_robot.geometry.angles import wrap_rad
from ins_robot.logs import botvac
from ins_robot.logs.botvac import read_botvac

START_NS = 1_504_645_341_000_000_000
TRACK_M = 0.248


def pose_at(t):
    """Stand for 2 s, then drive a circle of 0.5 m radius, left about."""
    angle = 0.4 * max(0.0, t - 2.0)
    return 0.5 * math.sin(angle), 0.5 * (1 - math.cos(angle)), angle


def room_range(x, y, bearing):
    """Distance to the walls of a room from (-2, -2) to (2, 2)."""
    c, s = math.cos(bearing), math.sin(bearing)
    return min(
        ((2.0 if c > 0 else -2.0) - x) / c if abs(c) > 1e-9 else math.inf,
        ((2.0 if s > 0 else -2.0) - y) / s if abs(s) > 1e-9 else math.inf,
    )


def rows(bias=0.01):
    def row(name, t, *values):
        stamp = START_NS + round(t * 1e9)
        return ",".join(f'"{v}"' for v in (name, stamp, *values))

    lines = []
    for i in range(1200):
        rate = 0.4 if i >= 200 else 0.0
        lines.append(row("gyro_yaw", 0.01 * i, -(rate) + bias))
    for i in range(40):
        t = 0.3 * i + 0.3
        angle = pose_at(t - botvac.WHEEL_DELAY_S)[2]
        left, right = (0.5 - 0.5 * TRACK_M) * angle, (0.5 + 0.5 * TRACK_M) * angle
        lines += [row("dist", t, left - 3.753, right + 4.31), row("odom", t, 0, 0, 0, 0, 0)]
    for i in range(38):
        t = 0.3 * i + 0.35
        ranges = []
        for beam in range(360):
            at = t + botvac.SWEEP_START_S + botvac.SWEEP_TIME_S * beam / 360
            x, y, heading = pose_at(at)
            x -= 0.09 * math.cos(heading)
            y -= 0.09 * math.sin(heading)
            distance = room_range(x, y, heading + math.radians(beam))
            ranges.append("0.0" if beam % 3 == 0 else 17.0 if beam % 50 == 1 else distance)
        lines.append(row("scan", t, *ranges))
    random.Random(3).shuffle(lines)
    return lines


@pytest.fixture(scope="module")
def lines():
    return rows()


@pytest.fixture
def log(tmp_path):
    def write(lines, end="\n"):
        path = tmp_path / "log.csv"
        path.write_text("\n".join(lines) + end)
        return path

    return write


def test_rows_in_any_order_give_the_way_driven(log, lines):
    read = read_botvac(log(lines))
    stamps_s = [r.stamp_s for r in read.records]
    assert stamps_s == sorted(stamps_s)
    assert (read.scan_count, len(read.records)) == (38, 78)
    for record in read.records:
        time_s = record.stamp_s - START_NS * 1e-9
        if time_s > 11.6:  # past the last that the wheels told
            continue
        x, y, heading = pose_at(time_s)
        got = record.odom_from_base
        assert (got.x_m, got.y_m) == pytest.approx((x, y), abs=0.02)
        assert wrap_rad(got.heading_rad - heading) == pytest.approx(0.0, abs=0.02)


def test_scans_taken_while_driving_lie_on_the_walls(log, lines):
    read = read_botvac(log(lines))
    for record in read.records:
        if record.scan is None:
            continue
        points = (record.odom_from_base @ read.base_from_lrf).apply(record.scan.points_lrf_m())
        off_m = np.abs(np.abs(points).max(axis=1) - 2.0)
        assert off_m.max() < 0.03
        assert len(points) == 235  # 360 less a third, less what is too far


def test_readings_past_the_range_of_the_device_are_dropped(log, lines):
    read = read_botvac(log(lines))
    assert all(np.nanmax(r.scan.ranges_m) < 6.0 for r in read.records if r.scan is not None)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('"scan","1504645341622560024","1.0"', ":1: 'scan' has 3 words, needs 362"),
        ('"dist","1504645341622560024","1.0"', ":1: 'dist' has 3 words"),
        ('"dist","1504645341622560024","1.0","2.0","3.0"', "has 3 values, must have 2"),
        ('"dist","x","1.0","2.0"', "the stamp is 'x'"),
        ('"dist","1504645341622560024","1.0","y"', "'y' is not a number"),
        ('"gyro_yaw","1504645341622560024","nan"', "not finite"),
        ('"bumper","1504645341622560024","1"', "'bumper' is no kind of row"),
    ],
)
def test_a_wrong_row_is_named(log, lines, line, words):
    with pytest.raises(InputError, match=words):
        read_botvac(log([line, *lines]))


def test_a_cut_row_is_named(log, lines):
    number = len(lines) + 1
    stamp = "1504645341622560024"
    for cut in (f'"gyro_yaw","{stamp}","0.00', f'"scan","{stamp}","1.', '"di'):
        with pytest.raises(InputError, match=f":{number}: "):
            read_botvac(log([*lines, cut], end=""))


@pytest.mark.parametrize("name", ["dist", "scan", "gyro_yaw"])
def test_a_recording_without_one_kind_of_rows_is_refused(log, lines, name):
    with pytest.raises(InputError, match=f"fewer than two rows of {name}"):
        read_botvac(log([line for line in lines if not line.startswith(f'"{name}"')]))
