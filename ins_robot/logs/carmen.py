# SPDX-License-Identifier: MIT
"""CARMEN logs: `FLASER`, `ROBOTLASER1` and `ODOM` lines, as in the public SLAM data sets.

    FLASER n r1..rn  laser x y theta  odom x y theta  time host logger_time
    ODOM x y theta  tv rv accel  time host logger_time
    ROBOTLASER1 type start fov step max_range accuracy remission n r1..rn m e1..em
                laser x y theta  robot x y theta  tv rv fsd ssd turn  time host logger_time

Other lines (PARAM, SYNC, RLASER, ...) are passed over. The lines' order is the order of time,
even where stamps, taken late, go back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.logs.sensor_log import (
    LogRecord,
    OdometryNoise,
    SensorLog,
    beam_bearings_rad,
)
from ins_robot.logs.text_lines import Line, split_lines
from ins_robot.messages import LaserScan

WORDS = frozenset(
    {
        *("FLASER", "RLASER", "ODOM", "PARAM", "SYNC", "TRUEPOS", "NMEA-GGA", "NMEA-RMC"),
        *("ROBOTLASER1", "ROBOTLASER2", "RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4"),
    }
)

NO_READING_M = 80.0
RANGE_TRUSTED_M = 8.0  # the near mode of a SICK
RANGE_STD_M = 0.015  # SICK LMS 200: 10 mm resolution, 10 to 20 mm noise
ROBOT_RADIUS_M = 0.25  # the Pioneers and B21s of these logs; for the picture only
BEAMS_MAX = 10_000
MOUNTING_STD_MAX_M = 0.005  # laser poses that wander more against the odometry are no mounting
_POSE = 3
_TRAILER = 3  # time, host, logger time


def read_carmen(path: Path, fov_rad: float | None = None) -> SensorLog:
    """Read a whole log.

    Parameters
    ----------
    path : Path
        The file.
    fov_rad : float, optional
        What the beams of `FLASER` lines span, when it is not 180 deg.

    Raises
    ------
    InputError
        With the line number, when a line is malformed or cut off, or when no scan is found.
    """
    records: list[LogRecord] = []
    lasers: list[FloatArray] = []
    parser = _ScanParser(fov_rad or math.pi)
    for line in split_lines(path):
        word = line.words[0]
        if word == "ODOM":
            records.append(_odometry(line))
        elif word == parser.scan_word or (
            parser.scan_word is None and word in {"FLASER", "ROBOTLASER1"}
        ):
            record, odom_from_laser = parser.scan(line)
            records.append(record)
            lasers.append(odom_from_laser)
        elif line.is_cut and word not in WORDS:
            raise line.error(f"the log is cut off here ('{word[:40]}'); copy it again")
    if not lasers:
        raise InputError(f"{path}: no FLASER or ROBOTLASER1 line, so there is nothing to map")
    return SensorLog(
        kind="CARMEN log",
        records=records,
        base_from_lrf=_mounting(lasers, records),
        motion_model=OdometryNoise(),
        range_trusted_m=RANGE_TRUSTED_M,
        robot_radius_m=ROBOT_RADIUS_M,
    )


def _odometry(line: Line) -> LogRecord:
    line.need(8 + (_TRAILER - 1) * line.is_cut, "ODOM")
    return LogRecord(stamp_s=line.finite(7, "the time"), odom_from_base=_pose(line, 1))


def _pose(line: Line, start: int) -> Pose2:
    values = line.numbers(start, start + _POSE)
    if not np.isfinite(values).all():
        raise line.error("the pose is not finite")
    return Pose2(float(values[0]), float(values[1]), wrap_rad(float(values[2])))


CountArray = NDArray[np.int8]


class _ScanParser:
    """Scan lines of the first kind met; a log often holds each scan in both kinds."""

    def __init__(self, fov_rad: float) -> None:
        self.scan_word: str | None = None
        self._fov_rad = fov_rad
        self._bearings: dict[tuple[float, ...], FloatArray] = {}
        # what scans have in common is shared: a log holds thousands
        self._zeros: dict[int, FloatArray] = {}
        self._whole: dict[int, tuple[FloatArray, CountArray]] = {}

    def scan(self, line: Line) -> tuple[LogRecord, FloatArray]:
        """The record, and the laser's pose (3,) in the odometry's frame."""
        self.scan_word = line.words[0]
        if self.scan_word == "FLASER":
            return self._flaser(line)
        return self._robotlaser(line)

    def _flaser(self, line: Line) -> tuple[LogRecord, FloatArray]:
        line.need(2, "FLASER")
        beams = line.count(1, "the number of beams", BEAMS_MAX)
        poses = 2 + beams
        stamp = poses + 2 * _POSE
        line.need(stamp + 1 + (_TRAILER - 1) * line.is_cut, f"FLASER of {beams} beams")
        key = (beams, -0.5 * self._fov_rad, self._fov_rad)
        if key not in self._bearings:
            self._bearings[key] = beam_bearings_rad(beams, self._fov_rad)
        scan = self._laser_scan(line, 2, self._bearings[key], NO_READING_M, stamp)
        return _scan_record(line, scan, poses)

    def _robotlaser(self, line: Line) -> tuple[LogRecord, FloatArray]:
        line.need(9, "ROBOTLASER1")
        start_rad = line.finite(2, "the first bearing")
        step_rad = line.finite(4, "the angle between beams")
        limit_m = line.finite(5, "the range limit")
        beams = line.count(8, "the number of beams", BEAMS_MAX)
        remissions = 9 + beams
        line.need(remissions + 1, f"ROBOTLASER1 of {beams} beams")
        if line.words[remissions] == "0":
            poses = remissions + 1
        else:
            poses = (
                remissions + 1 + line.count(remissions, "the number of remissions", BEAMS_MAX)
            )
        stamp = poses + 2 * _POSE + 5
        line.need(stamp + 1 + (_TRAILER - 1) * line.is_cut, f"ROBOTLASER1 of {beams} beams")
        key = (beams, start_rad, step_rad)
        if key not in self._bearings:
            bearings_rad = np.asarray(start_rad + step_rad * np.arange(beams), dtype=np.float64)
            self._bearings[key] = bearings_rad
        limit_m = min(limit_m, NO_READING_M) if limit_m > 0.0 else NO_READING_M
        scan = self._laser_scan(line, 9, self._bearings[key], limit_m, stamp)
        return _scan_record(line, scan, poses)

    def _laser_scan(
        self, line: Line, start: int, bearings_rad: FloatArray, limit_m: float, stamp: int
    ) -> LaserScan:
        beams = len(bearings_rad)
        ranges_m = line.numbers(start, start + beams)
        is_valid = (ranges_m > 0.0) & (ranges_m < limit_m)  # NaN is neither
        ranges_m[~is_valid] = np.nan
        zeros = self._zeros.setdefault(beams, np.zeros(beams))
        std_m, counts = np.where(is_valid, RANGE_STD_M, np.nan), is_valid.astype(np.int8)
        if is_valid.all():
            std_m, counts = self._whole.setdefault(beams, (std_m, counts))
        return LaserScan(
            stamp_s=line.finite(stamp, "the time"),
            bearings_rad=bearings_rad,
            ranges_m=ranges_m,
            range_std_m=std_m,
            beam_offsets_s=zeros,
            range_max_m=limit_m,
            valid_counts=counts,
        )


def _scan_record(line: Line, scan: LaserScan, poses: int) -> tuple[LogRecord, FloatArray]:
    odom_from_laser = _pose(line, poses)
    odom_from_base = _pose(line, poses + _POSE)
    record = LogRecord(stamp_s=scan.stamp_s, odom_from_base=odom_from_base, scan=scan)
    return record, odom_from_laser.as_array()


def _mounting(lasers: list[FloatArray], records: Iterable[LogRecord]) -> Pose2:
    """base_from_lrf by the two poses of each scan line, where they agree on one.

    In some logs the first pose is not the laser's but a corrected one; then it is passed over.
    """
    bases = [r.odom_from_base.as_array() for r in records if r.scan is not None]
    seen = between(np.array(bases), np.array(lasers))
    middle = np.median(seen, axis=0)
    if np.abs(seen[:, :2] - middle[:2]).mean() > MOUNTING_STD_MAX_M:
        return Pose2()
    return Pose2.from_array(np.round(middle, 4))
