# SPDX-License-Identifier: MIT
"""Logs of any building whose scans somebody laid together, replayed with odometry made bad.

    python tools/bad_odometry.py corrected/*.log --out runs/odometry --seeds 3 --jobs 2

In go CARMEN logs as GMapping writes them, with a corrected pose at each scan; what they lack is
odometry, and here it is made, in three grades, for the scans as they are and as an XV-11 sees
them (6 m, half of the beams, silence says nothing). One line per log, sensor and grade: how far
places seen again, two scans within 1.5 m and more than 30 scans apart, lie from where the
correction has them: the mean of each seed, of all of them the 95th percentile, the largest, and
the mean turn. That correction is another program's, no ground truth: below 0.05 m the figures
tell little. Each run's files go to OUT/LOG-SENSOR-GRADE-SEED.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ins_robot.config import Config
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.logs.carmen import read_carmen
from ins_robot.logs.replay import replay_log
from ins_robot.logs.run_directory import prepare_directory, write_run
from ins_robot.logs.sensor_log import SensorLog
from ins_robot.messages import LaserScan

XV11_RANGE_M = 6.0
XV11_SILENT_SHARE = 0.5
SEEN_AGAIN_M = 1.5
SEEN_AGAIN_SCANS = 30
COLUMNS = (
    "log",
    "sensor",
    "odometry",
    "scans",
    "mean m",
    "p95 m",
    "max m",
    "deg",
)


@dataclass(frozen=True)
class Grade:
    """Standard deviations after a metre or a radian; `bias` is turned in each metre."""

    name: str
    along: float
    across: float
    turn: float
    bias_rad: float = 0.0


GRADES = (
    Grade("good", 0.02, 0.01, 0.05),
    Grade("fair", 0.04, 0.03, 0.10, 0.01),
    Grade("poor", 0.10, 0.06, 0.15, 0.03),
)


@dataclass(frozen=True)
class Job:
    path: Path
    is_xv11: bool
    grade: Grade
    seed: int
    out: Path

    @property
    def name(self) -> str:
        sensor = "xv11" if self.is_xv11 else "laser"
        return f"{self.path.stem}-{sensor}-{self.grade.name}-{self.seed}"


def with_bad_odometry(poses: FloatArray, grade: Grade, rng: np.random.Generator) -> FloatArray:
    """(N, 3) what wheels of that grade would have said of the way through `poses` (N, 3)."""
    steps = between(poses[:-1], poses[1:])
    steps[:, 2] = wrap_rad(steps[:, 2])
    way_m, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    noise = rng.standard_normal(steps.shape)
    steps[:, 0] += noise[:, 0] * grade.along * np.sqrt(way_m)
    steps[:, 1] += noise[:, 1] * grade.across * np.sqrt(way_m)
    steps[:, 2] += noise[:, 2] * grade.turn * np.sqrt(turn + 0.1 * way_m)
    steps[:, 2] += grade.bias_rad * way_m
    led = [np.zeros(3)]
    for step in steps:
        led.append(compose(led[-1], step))
    return np.array(led)


def as_xv11(scan: LaserScan, rng: np.random.Generator) -> LaserScan:
    """The scan with what an XV-11 sees of it."""
    is_lost = (scan.ranges_m > XV11_RANGE_M) | (
        rng.random(scan.ranges_m.shape) < XV11_SILENT_SHARE
    )
    is_valid = np.isfinite(scan.ranges_m) & ~is_lost
    return replace(
        scan,
        ranges_m=np.where(is_valid, scan.ranges_m, np.nan),
        range_std_m=np.where(is_valid, scan.range_std_m, np.nan),
        range_max_m=XV11_RANGE_M,
        valid_counts=is_valid.astype(np.int8),
    )


def run(job: Job) -> tuple[int, FloatArray, FloatArray]:
    """Replay one log: how many scans; of places seen again, metres and degrees off (P,)."""
    log = read_carmen(job.path)
    rng = np.random.default_rng(job.seed)
    records = [record for record in log.records if record.scan is not None]
    corrected = np.array([record.odom_from_base.as_array() for record in records])
    led = with_bad_odometry(corrected, job.grade, rng)
    worse = [
        replace(
            record,
            odom_from_base=Pose2.from_array(pose),
            scan=as_xv11(record.scan, rng) if job.is_xv11 else record.scan,
        )
        for record, pose in zip(records, led, strict=True)
        if record.scan is not None
    ]
    bad: SensorLog = replace(log, records=worse, base_from_lrf=Pose2())
    result = replay_log(
        bad, Config(), job.name, np.random.default_rng(job.seed), time.process_time, _silent
    )
    prepare_directory(job.out / job.name)
    write_run(job.out / job.name, result)
    return len(worse), *seen_again(corrected, result.map_from_base)


def line(job: Job, runs: Sequence[tuple[int, FloatArray, FloatArray]]) -> str:
    """Of the table, for all seeds of a job."""
    off_m, off_deg = (np.concatenate([run[k] for run in runs]) for k in (1, 2))
    cells = (
        job.path.stem,
        "as an XV-11" if job.is_xv11 else "as it is",
        job.grade.name,
        str(runs[0][0]),
        ", ".join(f"{run[1].mean():.3f}" if len(run[1]) else "-" for run in runs),
        *(
            (f"{np.quantile(off_m, 0.95):.3f}", f"{off_m.max():.2f}", f"{off_deg.mean():.2f}")
            if len(off_m)
            else ("none seen again", "-", "-")
        ),
    )
    return "| " + " | ".join(cells) + " |"


def seen_again(corrected: FloatArray, found: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P,) metres and degrees by which pairs of scans of one place lie otherwise."""
    pairs = cKDTree(corrected[:, :2]).query_pairs(SEEN_AGAIN_M, output_type="ndarray")
    first, second = pairs[pairs[:, 1] - pairs[:, 0] > SEEN_AGAIN_SCANS].T
    wanted = between(corrected[first], corrected[second])
    off = between(found[first], found[second]) - wanted
    return np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(wrap_rad(off[:, 2])))


def _silent(share: float) -> None:
    pass


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", nargs="+", type=Path, help="corrected CARMEN logs")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    jobs = [
        Job(path, is_xv11, grade, seed, args.out)
        for path in args.logs
        for is_xv11 in (False, True)
        for grade in GRADES
        for seed in range(1, args.seeds + 1)
    ]
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS), flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        runs = []
        for job, result in zip(jobs, pool.map(run, jobs), strict=True):
            runs.append(result)
            if job.seed == args.seeds:
                print(line(job, runs), flush=True)
                runs = []
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
