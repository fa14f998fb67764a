# SPDX-License-Identifier: MIT
"""The whole daemon on the wire over many worlds and seeds: one table, do the bars hold.

    python tools/benchmark_system.py --out runs/bench                 # five worlds, seeds 0..4
    python tools/benchmark_system.py --worlds DIR --out runs/bench28  # all of DIR, start 0
    ... --set slam.estimator=odometry --jobs 2
    ... --fault gyro_bias_step 60 60 --fault gyro_bias_step 240 60  # in each run

DIR holds *.yaml and a worlds.csv with name, start0_x_m, start0_y_m. One JSON line per run goes
to OUT/results.jsonl; a run already there is not run again (delete the file to start afresh).
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from ins_robot.cli.commands.simulate import add_fault_argument

BUILT_IN = ("open_room", "rooms", "corridor_loop", "clutter", "office")
COLUMNS = {
    "state": "{}",
    "coverage": "{:.3f}",
    "localization_rmse_m": "{:.3f}",
    "heading_rmse_deg": "{:.2f}",
    "wall_error_m": "{:.3f}",
    "collisions": "{}",
    "scans": "{}",
    "path_length_m": "{:.1f}",
    "duration_s": "{:.0f}",
    "lrf_on_s": "{:.0f}",
    "wall_time_s": "{:.1f}",
    "slam_ms_median": "{:.1f}",
    "peak_rss_mb": "{:.0f}",
}


@dataclass(frozen=True)
class Job:
    name: str
    world: str
    start: str | None
    seed: int


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=Path, help="directory of worlds; default: the five")
    parser.add_argument("--only", nargs="*", default=[], help="names of worlds")
    parser.add_argument(
        "--seeds", type=int, default=None, help="0..N-1 (five worlds: 5, else 1)"
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    add_fault_argument(parser)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    jobs = list_jobs(args)
    if args.only:
        jobs = [job for job in jobs if job.name.rsplit("-", 1)[0] in args.only]
    args.out.mkdir(parents=True, exist_ok=True)
    results_file = args.out / "results.jsonl"
    done = read_results(results_file)
    with ThreadPoolExecutor(args.jobs) as pool, results_file.open("a") as file:
        for row in pool.map(
            lambda job: run(job, args), [job for job in jobs if job.name not in done]
        ):
            file.write(json.dumps(row) + "\n")
            file.flush()
            done[row["run"]] = row
            print(markdown_row(row), file=sys.stderr, flush=True)
    rows = [done[job.name] for job in jobs]
    print(table(rows))
    return 0 if all(row["state"] == "complete" for row in rows) else 1


def list_jobs(args: argparse.Namespace) -> list[Job]:
    if args.worlds is None:
        seeds = range(args.seeds or 5)
        return [Job(f"{name}-{seed}", name, None, seed) for name in BUILT_IN for seed in seeds]
    jobs = []
    with (args.worlds / "worlds.csv").open() as file:
        for row in csv.DictReader(file):
            start = f"{row['start0_x_m']},{row['start0_y_m']}"
            world = str(args.worlds / f"{row['name']}.yaml")
            jobs += [
                Job(f"{row['name']}-{seed}", world, start, seed)
                for seed in range(args.seeds or 1)
            ]
    return jobs


def run(job: Job, args: argparse.Namespace) -> dict:
    command = [
        sys.executable,
        "-m",
        "ins_robot",
        "simulate",
        job.world,
        "--seed",
        str(job.seed),
        "--out",
        str(args.out / job.name),
        "--json",
    ]
    if job.start is not None:
        command += ["--start", job.start]
    for override in args.overrides:
        command += ["--set", override]
    for fault in args.faults:
        command += ["--fault", *fault]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    try:
        summary = json.loads(done.stdout)
    except json.JSONDecodeError:
        summary = {"state": "crashed", "reason": done.stderr.strip()[-2000:]}
    return {"run": job.name, **summary}


def read_results(path: Path) -> dict[str, dict]:
    if not path.exists():
        return {}
    return {row["run"]: row for row in map(json.loads, path.read_text().splitlines())}


def markdown_row(row: dict) -> str:
    cells = [form.format(row[key]) if key in row else "-" for key, form in COLUMNS.items()]
    if row["state"] not in ("complete",):
        cells.append(str(row.get("reason", ""))[-300:])
    return f"| {row['run']} | " + " | ".join(cells) + " |"


def table(rows: list[dict]) -> str:
    lines = ["| run | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    lines += [markdown_row(row) for row in rows]
    ended = [row for row in rows if "coverage" in row]
    if ended:

        def column(key: str) -> list[float]:
            return [row[key] for row in ended]

        lines += [
            "",
            f"{len(rows)} runs, {sum(r['state'] == 'complete' for r in rows)} complete; "
            f"coverage min {min(column('coverage')):.3f} median "
            f"{statistics.median(column('coverage')):.3f}; "
            f"localization median {statistics.median(column('localization_rmse_m')):.3f} "
            f"max {max(column('localization_rmse_m')):.3f} m; heading median "
            f"{statistics.median(column('heading_rmse_deg')):.2f} deg; wall error median "
            f"{statistics.median(column('wall_error_m')):.3f} m; "
            f"collisions {sum(column('collisions'))}; robot time / wall time median "
            f"{statistics.median(r['duration_s'] / r['wall_time_s'] for r in ended):.1f}",
        ]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
