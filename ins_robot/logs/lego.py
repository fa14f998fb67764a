# SPDX-License-Identifier: MIT
"""The LEGO robot's directory: text files of `S` (scan), `M` (motors) and `P` (reference) lines.

    S time_ms n r1..rn      ranges in mm
    M time_ms left * * * right ...      wheel angles in ticks

The files are told by their content. Odometry is two-wheeled, between motor lines it is
interpolated. Geometry is that of C. Brenner's SLAM lectures; track and scan delay were measured
on the recording, by scans laid on one another and by the reference positions.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.sensor_log import LogRecord, OdometryNoise, SensorLog
from ins_robot.logs.text_lines import Line, split_lines
from ins_robot.messages import LaserScan
from ins_robot.sensing.deskew import deskew

WORDS = frozenset({"S", "M", "P", "L", "F", "D", "C"})

METRES_PER_TICK = 0.349e-3
TRACK_M = 0.172
BEAM_STEP_RAD = 0.006135923151543
BEAM_AHEAD = 330.0
BASE_FROM_LRF = Pose2(0.030, 0.0, -0.06981317007977318)
SCAN_DELAY_S = 0.4  # scans were taken this long before their stamps
RANGE_MIN_M, RANGE_MAX_M = 0.10, 4.0  # a Hokuyo URG; nearer is the robot itself
RANGE_STD_M = 0.01
ROBOT_RADIUS_M = 0.10
ODOMETRY_NOISE = OdometryNoise(turn_per_m=0.1, turn_per_rad=0.1)

_MS = 1e-3
_MM = 1e-3


def read_lego(directory: Path) -> SensorLog:
    """Read a whole directory.

    Raises
    ------
    InputError
        With file and line, when a line is malformed or cut off, or scans or motors missing.
    """
    scan_lines: list[Line] = []
    motor_lines: list[Line] = []
    for path in sorted(directory.glob("*.txt")):
        for line in split_lines(path):
            if line.words[0] == "S":
                scan_lines.append(line)
            elif line.words[0] == "M":
                motor_lines.append(line)
            elif line.words[0] not in WORDS:
                break
    for lines, what in ((scan_lines, "scans (S)"), (motor_lines, "motor ticks (M)")):
        if not lines:
            raise InputError(f"{directory}: no lines with {what}; is this the LEGO directory?")
    stamps_s, ticks = _motors(motor_lines)
    poses = drive(ticks)
    records = [
        LogRecord(stamp_s=float(s), odom_from_base=Pose2.from_array(pose))
        for s, pose in zip(stamps_s, poses, strict=True)
    ]
    records += [_scan_record(_scan(line), stamps_s, poses) for line in scan_lines]
    records.sort(key=lambda record: record.stamp_s)
    return SensorLog(
        kind="LEGO directory",
        records=records,
        base_from_lrf=BASE_FROM_LRF,
        motion_model=ODOMETRY_NOISE,
        range_trusted_m=RANGE_MAX_M,
        robot_radius_m=ROBOT_RADIUS_M,
    )


def _motors(lines: list[Line]) -> tuple[FloatArray, FloatArray]:
    """Stamps (N,) and ticks (N, 2), left and right."""
    rows = []
    for line in lines:
        line.need(7 + line.is_cut, "M")
        rows.append([line.finite(i, "the motor line") for i in (1, 2, 6)])
    table = np.array(rows)
    back = np.flatnonzero(np.diff(table[:, 0]) < 0.0)
    if len(back):
        raise lines[int(back[0]) + 1].error("the time goes back")
    return table[:, 0] * _MS, table[:, 1:]


def drive(ticks: FloatArray) -> FloatArray:
    """(N, 3) odom_from_base of the axle's middle, by ticks (N, 2) of left and right wheel."""
    left, right = np.diff(ticks, axis=0).T * METRES_PER_TICK
    turns = (right - left) / TRACK_M
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    # The chord of an arc points half the turn off its start.
    chord = 0.5 * (left + right) * np.sinc(0.5 * turns / math.pi)
    middle = heading[:-1] + 0.5 * turns
    x_m = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y_m = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    return np.column_stack([x_m, y_m, wrap_rad(heading)])


def _scan_record(scan: LaserScan, stamps_s: FloatArray, poses: FloatArray) -> LogRecord:
    """The scan as it would have looked at its stamp."""
    headings = np.unwrap(poses[:, 2])
    times_s = scan.stamp_s + np.array([0.0, -SCAN_DELAY_S])
    rows = (np.interp(times_s, stamps_s, row) for row in (poses[:, 0], poses[:, 1], headings))
    now, then = np.column_stack(list(rows))
    at_beams = np.broadcast_to(then, (len(scan.ranges_m), 3))
    return LogRecord(
        stamp_s=scan.stamp_s,
        odom_from_base=Pose2.from_array(now),
        scan=deskew(scan, at_beams, now, BASE_FROM_LRF),
    )


def _scan(line: Line) -> LaserScan:
    line.need(3, "S")
    beams = line.count(2, "the number of beams", 10_000)
    line.need(3 + beams, f"S of {beams} beams")
    ranges_m = line.numbers(3, 3 + beams) * _MM
    is_valid = (ranges_m >= RANGE_MIN_M) & (ranges_m <= RANGE_MAX_M)
    ranges_m[~is_valid] = np.nan
    return LaserScan(
        stamp_s=line.finite(1, "the time") * _MS,
        bearings_rad=np.asarray((np.arange(beams) - BEAM_AHEAD) * BEAM_STEP_RAD, dtype=float),
        ranges_m=ranges_m,
        range_std_m=np.where(is_valid, RANGE_STD_M, np.nan),
        beam_offsets_s=np.full(beams, -SCAN_DELAY_S),
        range_max_m=RANGE_MAX_M,
        valid_counts=is_valid.astype(np.int8),
    )
