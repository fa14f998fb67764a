# SPDX-License-Identifier: MIT
"""What every foreign log becomes: odometry poses and scans in the order of recording.

The readers of one kind each (`carmen`, `botvac`, `lego`) produce a `SensorLog`, `open_log`
chooses among them, `replay` runs SLAM on it. A log brings its own geometry, range limit and
noise; nothing of the configured robot enters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan, MotionIncrement


@dataclass(frozen=True, slots=True, kw_only=True)
class LogRecord:
    """One record of a log: where the odometry was, and the scan if it is one.

    `stamp_s` is the log's own; a log's stamps may go back, its order of records is what counts.
    """

    stamp_s: float
    odom_from_base: Pose2
    scan: LaserScan | None = None


class MotionModel(Protocol):
    """Turns two records into the motion between them, with its covariance."""

    def increment(
        self, before: LogRecord, after: LogRecord, way_m: float, turn_rad: float
    ) -> MotionIncrement:
        """Motion between two records; in between `way_m` was driven and `turn_rad` turned."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise(MotionModel):
    """How far odometry may be off: variances grow with the way driven and turned.

    Each figure is a standard deviation after one metre or one radian; `floor_*` is added to
    every increment.
    """

    along_per_m: float = 0.05
    across_per_m: float = 0.03
    turn_per_m: float = 0.05
    turn_per_rad: float = 0.08
    floor_m: float = 0.003
    floor_rad: float = 0.002

    def increment(
        self, before: LogRecord, after: LogRecord, way_m: float, turn_rad: float
    ) -> MotionIncrement:
        """Motion between two records; in between `way_m` was driven and `turn_rad` turned."""
        delta = before.odom_from_base.between(after.odom_from_base)
        along = self.along_per_m**2 * way_m + self.floor_m**2
        across = self.across_per_m**2 * way_m + self.floor_m**2
        heading = (
            self.turn_per_m**2 * way_m + self.turn_per_rad**2 * turn_rad + self.floor_rad**2
        )
        return MotionIncrement(
            from_stamp_s=before.stamp_s,
            to_stamp_s=after.stamp_s,
            delta=delta,
            covariance=np.diag([along, across, heading]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownMotion(MotionModel):
    """Without odometry: the robot may have moved as fast as such robots do."""

    speed_mps: float = 0.4
    yaw_rate_radps: float = 0.5
    pause_min_s: float = 0.1
    pause_max_s: float = 3.0

    def increment(
        self, before: LogRecord, after: LogRecord, way_m: float, turn_rad: float
    ) -> MotionIncrement:
        """No motion, with a covariance that grows with the time between the records."""
        pause_s = min(max(after.stamp_s - before.stamp_s, self.pause_min_s), self.pause_max_s)
        std = np.array([self.speed_mps, self.speed_mps, self.yaw_rate_radps]) * pause_s
        return MotionIncrement(
            from_stamp_s=before.stamp_s,
            to_stamp_s=after.stamp_s,
            delta=Pose2(),
            covariance=np.diag(std**2),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanStep:
    """A scan, the motion since the scan before it, and the row of its record."""

    row: int
    scan: LaserScan
    motion: MotionIncrement


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorLog:
    """A log as read: its records, and what its robot was.

    `kind` is for people. Up to `range_trusted_m` a beam without a reading may say that nothing
    was there. `robot_radius_m` is for the picture only.
    """

    kind: str
    records: Sequence[LogRecord]
    base_from_lrf: Pose2
    motion_model: MotionModel
    range_trusted_m: float
    robot_radius_m: float

    @property
    def has_odometry(self) -> bool:
        """Whether its records say how the robot moved."""
        return not isinstance(self.motion_model, UnknownMotion)

    @property
    def scan_count(self) -> int:
        """How many records are scans."""
        return sum(record.scan is not None for record in self.records)

    def scan_steps(self) -> Iterator[ScanStep]:
        """The scans, each with the motion that led to it since the last one."""
        last = self.records[0]
        way_m = turn_rad = 0.0
        before = last
        for row, record in enumerate(self.records):
            step = before.odom_from_base.between(record.odom_from_base)
            way_m += Pose2().distance_m(step)
            turn_rad += abs(step.heading_rad)
            before = record
            if record.scan is None:
                continue
            motion = self.motion_model.increment(last, record, way_m, turn_rad)
            yield ScanStep(row=row, scan=record.scan, motion=motion)
            last, way_m, turn_rad = record, 0.0, 0.0

    def without_odometry(self) -> SensorLog:
        """The same log as if the robot had had no wheels to ask."""
        return replace(
            self,
            records=[replace(record, odom_from_base=Pose2()) for record in self.records],
            motion_model=UnknownMotion(),
        )

    def with_every(self, nth: int) -> SensorLog:
        """Only every `nth` scan is left; the others stay as odometry records."""
        records, seen = [], 0
        for record in self.records:
            if record.scan is not None:
                seen += 1
                if (seen - 1) % nth:
                    record = replace(record, scan=None)
            records.append(record)
        return replace(self, records=records)


def beam_bearings_rad(count: int, fov_rad: float = math.pi) -> FloatArray:
    """(count,) bearings from -fov/2; an even count leaves out the last, an odd one has it.

    180 or 181 beams over 180 deg are 1 deg apart, 360 or 361 are 0.5 deg apart.
    """
    step = fov_rad / (count - count % 2) if count > 1 else 0.0
    return np.asarray(-0.5 * fov_rad + step * np.arange(count), dtype=np.float64)
