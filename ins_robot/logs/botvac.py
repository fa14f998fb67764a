# SPDX-License-Identifier: MIT
"""Botvac recordings: a CSV of `"name","stamp in ns",values...`, rows in no order of time.

`scan` 360 ranges (m, 0.0 = none), `dist` ways of left and right wheel (m), `gyro_yaw` (rad/s,
clockwise). Heading comes from the gyro, the way from the wheels; scans are de-skewed, for they
were taken while driving. Delays and mounting were measured on two such recordings, by where
gyro and wheels, and walls seen from many poses, agree best.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.sensor_log import LogRecord, OdometryNoise, SensorLog, beam_bearings_rad
from ins_robot.logs.text_lines import Line, read_lines
from ins_robot.messages import LaserScan
from ins_robot.sensing.deskew import deskew
from ins_robot.sensing.range_error import range_std_m

WIDTHS = {"scan": 360, "dist": 2, "gyro_yaw": 1}
NAMES = frozenset({*WIDTHS, "odom"})
ROWS_MIN = 2  # of each: the way is what changes from row to row

WHEEL_DELAY_S = 0.3  # `dist` rows carry the time at which the whole answer had arrived
SWEEP_START_S = -0.25  # the first beam of a scan, against the stamp of its row
SWEEP_TIME_S = 0.2  # five turns a second
BASE_FROM_LRF = Pose2(-0.09, 0.0, 0.0)
STANDSTILL_M = 0.002  # wheels that moved less between rows did not turn
ROBOT_RADIUS_M = 0.165
ODOMETRY_NOISE = OdometryNoise(turn_per_m=0.01, turn_per_rad=0.02)  # the gyro is good

XV11 = LrfConfig()  # the same family of range finders


@dataclass(frozen=True, slots=True)
class Series:
    """Rows of one name in order of time: stamps (N,) and values (N, width)."""

    stamps_s: FloatArray
    values: FloatArray


def read_botvac(path: Path) -> SensorLog:
    """Read a whole recording.

    Raises
    ------
    InputError
        With the line number, when a row is malformed or cut off; when a kind of row is missing.
    """
    series = read_series(path)
    way = _Way(series["dist"], series["gyro_yaw"])
    records = [
        LogRecord(stamp_s=float(stamp_s), odom_from_base=Pose2.from_array(pose))
        for stamp_s, pose in zip(
            series["dist"].stamps_s, way.poses_at(series["dist"].stamps_s), strict=True
        )
    ]
    scans = series["scan"]
    for stamp_s, ranges_m in zip(scans.stamps_s, scans.values, strict=True):
        records.append(_scan_record(float(stamp_s), ranges_m, way))
    records.sort(key=lambda record: record.stamp_s)
    return SensorLog(
        kind="Botvac recording",
        records=records,
        base_from_lrf=BASE_FROM_LRF,
        motion_model=ODOMETRY_NOISE,
        range_trusted_m=XV11.range_trusted_m,
        robot_radius_m=ROBOT_RADIUS_M,
    )


def _rows(path: Path) -> Iterator[Line]:
    for number, text, is_cut in read_lines(path):
        if text.strip():
            words = [word.strip().strip('"') for word in text.split(",")]
            yield Line(path, number, words, is_cut)


def read_series(path: Path) -> dict[str, Series]:
    """The rows of each name of `WIDTHS`, as recorded but in order of time.

    Raises
    ------
    InputError
        As `read_botvac`.
    """
    stamps_ns: dict[str, list[int]] = {name: [] for name in WIDTHS}
    values: dict[str, list[FloatArray]] = {name: [] for name in WIDTHS}
    for line in _rows(path):
        name = line.words[0]
        if name not in WIDTHS:
            if name not in NAMES:
                raise line.error(f"'{name[:40]}' is no kind of row of a Botvac recording")
            continue
        width = WIDTHS[name]
        if len(line.words) != width + 2 or line.is_cut:
            line.need(width + 2 + line.is_cut, f"'{name}'")
            raise line.error(f"'{name}' has {len(line.words) - 2} values, must have {width}")
        stamps_ns[name].append(line.count(1, "the stamp", 1 << 62))
        row = line.numbers(2, 2 + width)
        if not np.isfinite(row).all():
            raise line.error(f"'{name}' holds a value that is not finite")
        values[name].append(row)
    missing = [name for name, stamps in stamps_ns.items() if len(stamps) < ROWS_MIN]
    if missing:
        raise InputError(
            f"{path}: fewer than two rows of {', '.join(missing)}; no map can be made of it"
        )
    series = {}
    for name, stamps in stamps_ns.items():
        order = np.argsort(np.array(stamps), kind="stable")
        seconds = np.array(stamps)[order] * 1e-9
        series[name] = Series(seconds, np.array(values[name])[order])
    return series


class _Way:
    """Pose by dead reckoning at any time: heading from the gyro, distance from the wheels."""

    def __init__(self, wheels: Series, gyro: Series) -> None:
        self._stamps_s = gyro.stamps_s
        wheels_s, driven_m = wheels.stamps_s - WHEEL_DELAY_S, wheels.values
        rates = -(gyro.values[:, 0] - _gyro_bias(wheels_s, driven_m, gyro))
        turns = 0.5 * (rates[1:] + rates[:-1]) * np.diff(gyro.stamps_s)
        self._heading = np.concatenate([[0.0], np.cumsum(turns)])
        steps_m = np.diff(np.interp(gyro.stamps_s, wheels_s, driven_m.mean(axis=1)))
        middle = self._heading[:-1] + 0.5 * turns
        self._x_m = np.concatenate([[0.0], np.cumsum(steps_m * np.cos(middle))])
        self._y_m = np.concatenate([[0.0], np.cumsum(steps_m * np.sin(middle))])

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) odom_from_base; standing before the first and after the last gyro row."""
        x_m, y_m, heading = (
            np.interp(stamps_s, self._stamps_s, row)
            for row in (self._x_m, self._y_m, self._heading)
        )
        return np.column_stack([x_m, y_m, wrap_rad(heading)])


def _gyro_bias(wheels_s: FloatArray, driven_m: FloatArray, gyro: Series) -> float:
    """Mean rate while neither wheel turned; 0 when they always did."""
    moved_m = np.abs(np.diff(driven_m, axis=0)).max(axis=1)
    interval = np.searchsorted(wheels_s, gyro.stamps_s) - 1
    inside = (interval >= 0) & (interval < len(moved_m))
    still = np.zeros(len(interval), dtype=bool)
    still[inside] = moved_m[interval[inside]] < STANDSTILL_M
    return float(gyro.values[still, 0].mean()) if still.any() else 0.0


def _scan_record(stamp_s: float, ranges_m: FloatArray, way: _Way) -> LogRecord:
    beams = len(ranges_m)
    is_valid = (ranges_m >= XV11.range_min_m) & (ranges_m <= XV11.range_max_m)
    ranges_m = np.where(is_valid, ranges_m, np.nan)
    offsets_s = SWEEP_START_S + SWEEP_TIME_S * np.arange(beams) / beams
    raw = LaserScan(
        stamp_s=stamp_s,
        bearings_rad=beam_bearings_rad(beams, 2.0 * math.pi) + math.pi,
        ranges_m=ranges_m,
        range_std_m=range_std_m(ranges_m, XV11.range_std_floor_m, XV11.range_std_per_m3),
        beam_offsets_s=offsets_s,
        range_max_m=XV11.range_max_m,
        rpm=60.0 / SWEEP_TIME_S,
        valid_counts=is_valid.astype(np.int8),
    )
    pose = way.poses_at(np.array([stamp_s]))[0]
    return LogRecord(
        stamp_s=stamp_s,
        odom_from_base=Pose2.from_array(pose),
        scan=deskew(raw, way.poses_at(stamp_s + offsets_s), pose, BASE_FROM_LRF),
    )
