#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Estimators on the same recorded drives, paired: localisation and walls against the truth.

    python tools/benchmark_system.py --worlds DIR --out RUNS --set simulation.slip_std=0.03 ...
    python tools/compare_estimators.py RUNS --worlds DIR --out TABLE.jsonl [--jobs N]

RUNS holds recordings of simulated runs with truth.tum. Every estimator is given each recording,
so they all see the same bytes on the same way; what the robot would have done differently is
left out. One JSON line per replay goes to --out; a replay already there is not done again.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from ins_robot import config as configuration
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import read_journal
from ins_robot.logs.replay_journal import JournalOptions, JournalReplay
from ins_robot.logs.run_directory import read_tum
from ins_robot.simulation.truth import pose_errors, wall_error_m
from ins_robot.simulation.world import World

ESTIMATORS = ("odometry", "similarity", "fastslam", "particle", "auto")
METRICS = ("localization_rmse_m", "heading_rmse_deg", "wall_error_m")
RESAMPLES = 2000
CONFIDENCE = (2.5, 97.5)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, help="directory of run directories")
    parser.add_argument("--worlds", type=Path, help="directory of worlds; default: the five")
    parser.add_argument("--estimators", default=",".join(ESTIMATORS))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    estimators = args.estimators.split(",")
    lines = args.out.read_text().splitlines() if args.out.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {(row["run"], row["estimator"]) for row in rows}
    runs = sorted(path.parent for path in args.runs.glob("*/truth.tum"))
    todo = [(r, e) for r in runs for e in estimators if (r.name, e) not in done]
    work = partial(replay, worlds=args.worlds, overrides=args.overrides)
    with ProcessPoolExecutor(args.jobs) as pool, args.out.open("a") as file:
        for row in pool.map(work, *zip(*todo, strict=True)) if todo else ():
            file.write(json.dumps(row) + "\n")
            file.flush()
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    print(table(rows, estimators))
    return 0


def replay(run: Path, estimator: str, worlds: Path | None, overrides: list[str]) -> dict:
    """SLAM alone, on what the run recorded."""
    header, messages = read_journal(run / "run.journal")
    recorded = configuration.loads(header.config_toml, f"{run}: recorded configuration")
    config = configuration.with_overrides(recorded, [*overrides, f"slam.estimator={estimator}"])
    replayed = JournalReplay(config, JournalOptions(), time.process_time)
    replayed.core.survey.explorer.decide = lambda *_: None  # where to go has been decided
    for message in messages:
        replayed.feed(message)
    stamps, poses = replayed.core.corrected_trajectory()
    true_stamps, truth = read_tum(run / "truth.tum")
    truth[:, 2] = np.unwrap(truth[:, 2])
    true = np.stack([np.interp(stamps, true_stamps, truth[:, k]) for k in range(3)], axis=-1)
    true[:, 2] = wrap_rad(true[:, 2])
    off_m, off_rad = pose_errors(poses, true)
    survey = replayed.core.survey
    world, start = world_of(run.name.rsplit("-", 1)[0], worlds, config.robot.radius_m)
    return {
        "run": run.name,
        "estimator": estimator,
        "localization_rmse_m": float(np.sqrt(np.mean(off_m**2))),
        "heading_rmse_deg": float(np.degrees(np.sqrt(np.mean(off_rad**2)))),
        "wall_error_m": wall_error_m(world, start, replayed.core.survey.grid),
        "slam_ms_median": float(np.median(survey.slam_ms)),
    }


def world_of(name: str, worlds: Path | None, radius_m: float) -> tuple[World, Pose2]:
    if worlds is None:
        world = World.find(name)
        return world, world.start_pose(None, radius_m)
    with (worlds / "worlds.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if row["name"] == name)
    world = World.find(str(worlds / f"{name}.yaml"))
    start = Pose2(float(row["start0_x_m"]), float(row["start0_y_m"]), 0.0)
    return world, world.start_pose(start, radius_m)


def table(rows: list[dict], estimators: list[str]) -> str:
    """Median and worst of each, and the paired gain over odometry with its confidence."""
    by = {(row["run"], row["estimator"]): row for row in rows}
    runs = sorted({run for run, _ in by if all((run, e) in by for e in estimators)})
    lines = [
        f"{len(runs)} recordings; median / worst; in brackets the median ratio to odometry on "
        f"the same recording, {CONFIDENCE[1] - CONFIDENCE[0]:g} % bootstrap interval, and on "
        "how many it is better",
        "",
        "| estimator | " + " | ".join(METRICS) + " | slam_ms_median |",
        "|" + "---|" * (len(METRICS) + 2),
    ]
    rng = np.random.default_rng(0)
    for estimator in estimators:
        cells = [estimator]
        for metric in METRICS:
            values = np.array([by[run, estimator][metric] for run in runs])
            cell = f"{np.median(values):.3f} / {values.max():.3f}"
            if "odometry" in estimators and estimator != "odometry":
                base = np.array([by[run, "odometry"][metric] for run in runs])
                ratio = values / np.maximum(base, 1e-9)
                draws = rng.integers(0, len(runs), (RESAMPLES, len(runs)))
                low, high = np.percentile(np.median(ratio[draws], axis=1), CONFIDENCE)
                cell += (
                    f" ({np.median(ratio):.2f}, {low:.2f} to {high:.2f}; "
                    f"{int((values < base).sum())} of {len(runs)})"
                )
            cells.append(cell)
        cells.append(f"{np.median([by[run, estimator]['slam_ms_median'] for run in runs]):.1f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
