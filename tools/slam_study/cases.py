# SPDX-License-Identifier: MIT
"""The logs of the comparison, how each is scored, and what is wanted of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ins_robot.logs.open_log import find_log, read_log
from ins_robot.logs.sensor_log import LogRecord, SensorLog
from slam_study.scores import Camera, Relations, Scorer, ThinWalls

INTEL = Relations("slam/intel.relations")
FR079 = Relations("slam/fr079.relations", gap_s=1.5)
AHEAD_M = 0.04  # Freiburg 079: the log has the laser's poses only
PASSES = 10
PAUSE_S = 0.5


@dataclass(frozen=True)
class Case:
    """A log, cut down as told.

    `bar_m`, `bar_deg`: the error it may have at most. `ahead_m`: the robot's centre is that far
    ahead of what the log lets us track.
    """

    name: str
    file: str
    score: Scorer
    bar_m: float
    bar_deg: float | None = None
    every: int = 1
    has_odometry: bool = True
    passes: int = 1
    ahead_m: float = 0.0

    def read(self, data: Path) -> SensorLog:
        kind, path = find_log(data / self.file)
        log = read_log(kind, path)
        if not self.has_odometry:
            log = log.without_odometry()
        return to_and_fro(log.with_every(self.every), self.passes)


def to_and_fro(log: SensorLog, passes: int) -> SensorLog:
    """The log so many times, every other time backwards: one long drive without a jump."""
    first, last = log.records[0].stamp_s, max(record.stamp_s for record in log.records)
    period_s = last - first + PAUSE_S
    records: list[LogRecord] = []
    for k in range(passes):
        for record in reversed(log.records) if k % 2 else log.records:
            into_s = last - record.stamp_s if k % 2 else record.stamp_s - first
            records.append(_at(record, first + k * period_s + into_s))
    return replace(log, records=records)


def _at(record: LogRecord, stamp_s: float) -> LogRecord:
    scan = None if record.scan is None else replace(record.scan, stamp_s=stamp_s)
    return replace(record, stamp_s=stamp_s, scan=scan)


CASES = (
    Case("intel", "slam/intel.clf", INTEL, 0.036, 1.0),
    Case("fr079", "slam/fr079.clf", FR079, 0.040, 1.28, ahead_m=AHEAD_M),
    Case("intel_xv11", "slam/intel_xv11.clf", INTEL, 0.048),
    Case("fr079_xv11", "slam/fr079_xv11.clf", FR079, 0.040, ahead_m=AHEAD_M),
    Case("intel_every3", "slam/intel.clf", INTEL, 0.048, every=3),
    Case("fr079_scan_only", "slam/fr079.clf", FR079, 0.10, has_odometry=False, ahead_m=AHEAD_M),
    Case("lego", "robot/lego", Camera("robot/lego/robot4_reference.txt"), 0.020),
    Case("botvac", "robot/botvac_driving_around.csv", ThinWalls(), 0.05),
)
GROWTH = Case("growth", "slam/fr079_xv11.clf", FR079, 0.040, passes=PASSES, ahead_m=AHEAD_M)
BAR_MS = (8.0, 25.0)
BAR_RSS_MB = 120.0
BAR_GROWTH = 1.2
