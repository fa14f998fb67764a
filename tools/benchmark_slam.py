# SPDX-License-Identifier: MIT
"""All public logs and estimators: errors, cost, memory, growth, pictures; and other systems.

    python tools/benchmark_slam.py ../shared/data --out runs/slam
    ... --logs intel_xv11 lego --estimators particle no-loops particle+slam.particles=30
    ... --external karto=karto.tum hector@fr079_xv11=hector.tum,ahead=0.04

One table on stdout, one line per log and estimator: mean and worst of the seeds. A run's files
go to OUT/LOG-ESTIMATOR-SEED, trajectories of a log to OUT/LOG.png, figures to OUT/runs.jsonl;
a run in there is not run again. An external trajectory (TUM) is scored on `@LOG`, or on each
log whose stamps it has; `ahead` says how far ahead of the tracked point the robot's centre is.
Estimators: those of `slam.estimator`, `no-loops`, each with `+section.key=value`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from slam_study.ablations import is_drawn
from slam_study.cases import BAR_GROWTH, BAR_MS, BAR_RSS_MB, CASES, GROWTH, Case
from slam_study.trajectory import Trajectory
from slam_study.worker import Job, run

BY_NAME = {case.name: case for case in (*CASES, GROWTH)}
MATCHED_SHARE_MIN = 0.5  # of a log's relations, to count as a trajectory of it
COLUMNS = (
    "log",
    "estimator",
    "seeds",
    "error m, mean (worst)",
    "bar m",
    "error deg, mean (worst)",
    "ms per scan, median / p95",
    "times kernel",
    "last / first tenth",
    "peak RSS MB",
    "matched",
)


@dataclass(frozen=True)
class External:
    name: str
    log: str | None
    trajectory: Trajectory

    @staticmethod
    def parse(text: str) -> External:
        """NAME[@LOG]=FILE[,ahead=METRES]."""
        head, _, tail = text.partition("=")
        path, _, ahead = tail.partition(",ahead=")
        name, _, log = head.partition("@")
        if not path or (log and log not in BY_NAME):
            raise argparse.ArgumentTypeError(
                f"'{text}': must be NAME=FILE or NAME@LOG=FILE, LOG one of {', '.join(BY_NAME)}"
            )
        return External(name, log or None, Trajectory.read(Path(path), float(ahead or 0.0)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="directory of the recordings")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--logs", nargs="+", choices=list(BY_NAME), default=list(BY_NAME))
    parser.add_argument("--estimators", nargs="+", default=["auto"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--external", nargs="+", type=External.parse, default=[])
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    cases = [BY_NAME[name] for name in args.logs]
    jobs = [
        Job(case, estimator, seed)
        for case in cases
        for estimator in args.estimators
        for seed in range(args.seeds if is_drawn(estimator) and case is not GROWTH else 1)
    ]
    done = run_all(jobs, args)
    lines = []
    for case in cases:
        for estimator in args.estimators:
            rows = [
                done[job.name]
                for job in jobs
                if job.case is case and job.estimator == estimator
            ]
            lines.append(line(case, estimator, rows))
        outside = scored(case, args)
        lines += [line(case, one.name, [score]) for one, score in outside]
        draw(case, args, [one for one, _ in outside])
    print("| " + " | ".join(COLUMNS) + " |" + "\n" + "|---" * len(COLUMNS) + "|")
    print("\n".join(lines))
    print(
        f"\n**bold**: misses its bar (ms {BAR_MS[0]:g} / {BAR_MS[1]:g}, RSS {BAR_RSS_MB:g} MB, "
        f"growth {BAR_GROWTH:g}). Times are processor time."
    )
    return 0


def run_all(jobs: list[Job], args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The jobs' figures by name; each in a fresh process, so that its memory is its own."""
    file = args.out / "runs.jsonl"
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    done = {row["run"]: row for row in map(json.loads, text.splitlines())}
    todo = [job for job in jobs if job.name not in done]
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(args.jobs, context, max_tasks_per_child=1) as pool,
        file.open("a", encoding="utf-8") as log,
    ):
        futures = [pool.submit(run, job, args.data, args.out) for job in todo]
        for future in futures:
            row = future.result()
            done[row["run"]] = row
            log.write(json.dumps(row) + "\n")
            log.flush()
            print(line(BY_NAME[row["case"]], row["run"], [row]), file=sys.stderr, flush=True)
    return done


def scored(case: Case, args: argparse.Namespace) -> list[tuple[External, dict[str, Any]]]:
    """Each external trajectory of this log, with its score."""
    if not args.external or case is GROWTH:
        return []
    log = case.read(args.data)
    found = []
    for one in args.external:
        if one.log not in (None, case.name):
            continue
        score = case.score(one.trajectory, log, args.data)
        enough = MATCHED_SHARE_MIN * score.get("relations", 1.0)
        if one.log is not None or score["matched"] >= enough:
            found.append((one, score))
    return found


def draw(case: Case, args: argparse.Namespace, others: list[External]) -> None:
    from slam_study.pictures import draw_trajectories

    shown = {
        estimator: Trajectory.read(args.out / Job(case, estimator, 0).name / "trajectory.tum")
        for estimator in args.estimators
    }
    shown |= {one.name: one.trajectory for one in others}
    draw_trajectories(case.name, shown, args.out / f"{case.name}.png")


def line(case: Case, name: str, rows: list[dict[str, Any]]) -> str:
    """A line of the table: mean and worst over the seeds; times and memory: the median."""

    def values(key: str) -> list[float]:
        return [row[key] for row in rows if key in row]

    def spread(key: str, form: str, bar: float | None) -> str:
        found = values(key)
        if not found:
            return "-"
        mean, worst = float(np.mean(found)), max(found)
        text = f"{mean:{form}} ({worst:{form}})"
        return text if bar is None or mean <= bar else f"**{text}**"

    def middle(key: str, form: str, bar: float | None = None) -> str:
        found = values(key)
        if not found:
            return "-"
        value = float(np.median(found))
        text = f"{value:{form}}"
        return text if bar is None or value <= bar else f"**{text}**"

    kernel = values("kernel_ms")
    times = [middle("ms_median", ".1f", BAR_MS[0]), middle("ms_p95", ".1f", BAR_MS[1])]
    multiple = (
        f"{np.median(values('ms_median')) / np.median(kernel):.1f} / "
        f"{np.median(values('ms_p95')) / np.median(kernel):.1f}"
        if kernel
        else "-"
    )
    is_growth = case is GROWTH
    cells = [
        case.name,
        name,
        str(len(rows)),
        spread("error_m", ".4f", case.bar_m),
        f"{case.bar_m:.3f}",
        spread("error_deg", ".2f", case.bar_deg),
        " / ".join(times) if kernel else "-",
        multiple,
        middle("growth", ".2f", BAR_GROWTH if is_growth else None),
        middle("rss_mb", ".0f", BAR_RSS_MB),
        middle("matched", ".0f"),
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    raise SystemExit(main())
