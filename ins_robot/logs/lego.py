# SPDX-License-Identifier: MIT
"""The LEGO robot's directory: text files of `S` (scan), `M` (motors) and `P` (reference) lines.

    S time_ms n r1..rn      ranges in mm
    M time_ms left * * * right ...      wheel angles in ticks

The files are told by their content. Odometry is two-wheeled, between motor lines it is
interpolated. The base is the mark on the scanner that the camera follows; stamps and metres are
the camera's. Of the geometry the makers published little: it was measured on the recording.
Scans were laid into the arena, a rectangle (points to 7 mm), which gives the angle from beam to
beam, the sweep's time and the ranges' offset; `P` lines give the length of a metre and delays;
wheels come from the scans' poses.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.logs.sensor_log import LogRecord, OdometryNoise, SensorLog
from ins_robot.logs.text_lines import Line, split_lines
from ins_robot.messages import LaserScan
from ins_robot.sensing.deskew import deskew

WORDS = frozenset({"S", "M", "P", "L", "F", "D", "C"})

METRES_PER_TICK = 0.361e-3
TRACK_M = 0.180
AXLE_FROM_MARK = Pose2(0.048, 0.0, 0.0)
MOTOR_DELAY_S = 0.25  # the mark is where a motor line says so long after its stamp
BEAM_STEP_RAD = math.tau / 1000
BEAM_AHEAD = 330.0
BASE_FROM_LRF = Pose2(0.0, 0.0, -0.057)
SCAN_DELAY_S = 0.16  # the beam ahead was measured this long before its scan's stamp
REVOLUTION_S = 0.1
RANGE_SCALE = 1.127  # the camera's metre is the shorter one
RANGE_OFFSET_M = -0.026
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
    return table[:, 0] * _MS + MOTOR_DELAY_S, table[:, 1:]


def drive(ticks: FloatArray) -> FloatArray:
    """(N, 3) odom_from_base, from (0, 0, 0), by ticks (N, 2) of left and right wheel."""
    left, right = np.diff(ticks, axis=0).T * METRES_PER_TICK
    turns = (right - left) / TRACK_M
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    # The chord of an arc points half the turn off its start.
    chord = 0.5 * (left + right) * np.sinc(0.5 * turns / math.pi)
    middle = heading[:-1] + 0.5 * turns
    x_m = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y_m = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    mark = compose(np.column_stack([x_m, y_m, heading]), AXLE_FROM_MARK.as_array())
    odom_from_base = between(mark[0], mark)
    odom_from_base[:, 2] = wrap_rad(odom_from_base[:, 2])
    return odom_from_base


def _scan_record(scan: LaserScan, stamps_s: FloatArray, poses: FloatArray) -> LogRecord:
    """The scan as it would have looked at its stamp."""
    headings = np.unwrap(poses[:, 2])
    times_s = scan.stamp_s + np.concatenate([[0.0], scan.beam_offsets_s])
    rows = [np.interp(times_s, stamps_s, row) for row in (poses[:, 0], poses[:, 1], headings)]
    now, *at_beams = np.column_stack(rows)
    return LogRecord(
        stamp_s=scan.stamp_s,
        odom_from_base=Pose2.from_array(now),
        scan=deskew(scan, np.array(at_beams), now, BASE_FROM_LRF),
    )


def _scan(line: Line) -> LaserScan:
    line.need(3, "S")
    beams = line.count(2, "the number of beams", 10_000)
    line.need(3 + beams, f"S of {beams} beams")
    ranges_m = line.numbers(3, 3 + beams) * _MM
    is_valid = (ranges_m >= RANGE_MIN_M) & (ranges_m <= RANGE_MAX_M)
    ranges_m = np.where(is_valid, RANGE_SCALE * ranges_m + RANGE_OFFSET_M, np.nan)
    turned_rad = (np.arange(beams, dtype=np.float64) - BEAM_AHEAD) * BEAM_STEP_RAD
    return LaserScan(
        stamp_s=line.finite(1, "the time") * _MS,
        bearings_rad=turned_rad,
        ranges_m=ranges_m,
        range_std_m=np.where(is_valid, RANGE_STD_M, np.nan),
        beam_offsets_s=turned_rad * REVOLUTION_S / math.tau - SCAN_DELAY_S,
        range_max_m=RANGE_MAX_M,
        valid_counts=is_valid.astype(np.int8),
    )
