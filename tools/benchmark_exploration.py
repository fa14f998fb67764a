# SPDX-License-Identifier: MIT
"""Exploration strategies over many worlds on the pure core: no wire, no clock.

    python tools/benchmark_exploration.py --worlds DIR --out runs/exploration --jobs 2
    ... --strategies min-gap,auto --modes stop --poses perfect,estimated --seeds 2
    ... --reference-sensor                  # the conditions of the published baselines
    ... --scheduler tcp://HOST:8786         # the same cells on a Dask cluster

DIR holds map_server worlds and worlds.csv with their starts; with reference.jsonl beside it,
path lengths are compared with the near-optimal route on the known map. One JSON line per run
goes to OUT/results.jsonl, and a run already there is not run again. Tables go to stdout and
OUT/table.md, pictures of coverage against distance and time to OUT.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path

from exploration_study import report
from exploration_study.jobs import Job, finish, read_starts, run_here, run_on_cluster

from ins_robot.navigation.strategies import STRATEGY_NAMES

MODES, POSES = ("stop", "enroute"), ("perfect", "estimated")


def main(argv: list[str] | None = None) -> int:
    args = arguments().parse_args(argv)
    jobs = list_jobs(args)
    args.out.mkdir(parents=True, exist_ok=True)
    run = run_on_cluster(args.scheduler) if args.scheduler else run_here(args.jobs)
    rows = finish(jobs, args.out / "results.jsonl", run)
    reference = report.read_reference(args.worlds) if args.reference_sensor else {}
    text = f"{report.table(rows, reference)}\n\n{report.world_table(rows, reference)}\n"
    (args.out / "table.md").write_text(text)
    print(text)
    for file in report.plot(rows, args.out):
        print(file, file=sys.stderr)
    return 0


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=Path, required=True, help="directory of worlds")
    parser.add_argument("--only", default="", help="names of worlds, by comma; default all")
    parser.add_argument("--strategies", default=",".join(STRATEGY_NAMES), help="by comma")
    parser.add_argument("--modes", default=",".join(MODES), help="stop: one scan per goal")
    parser.add_argument("--poses", default=POSES[0], help="perfect, estimated")
    parser.add_argument("--starts", default="0", help="numbers of worlds.csv, by comma")
    parser.add_argument("--seeds", type=int, default=1, help="0..N-1, of the noise")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--reference-sensor", action="store_true")
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    parser.add_argument("--jobs", type=int, default=1, help="processes on this machine")
    parser.add_argument("--scheduler", help="address of a Dask scheduler")
    return parser


def list_jobs(args: argparse.Namespace) -> list[Job]:
    """Every cell, worlds outermost; a wrong name ends here, in one line."""
    if not (args.worlds / "worlds.csv").is_file():
        raise SystemExit(f"--worlds {args.worlds}: no worlds.csv there")
    known = read_starts(args.worlds)
    worlds = _chosen("--only", args.only, known) if args.only else list(known)
    strategies = _chosen("--strategies", args.strategies, STRATEGY_NAMES)
    modes = _chosen("--modes", args.modes, MODES)
    poses = _chosen("--poses", args.poses, POSES)
    if args.reference_sensor and poses != ["perfect"]:
        raise SystemExit("--poses estimated: the reference sensor has a perfect pose only")
    if args.seeds < 1:
        raise SystemExit(f"--seeds {args.seeds}: must be at least 1")
    starts = [int(start) for start in _chosen("--starts", args.starts, None)]
    for world, start in itertools.product(worlds, starts):
        if not 0 <= start < len(known[world]):
            raise SystemExit(
                f"--starts {start}: {world} has starts 0 to {len(known[world]) - 1}"
            )
    return [
        Job(
            folder=str(args.worlds.resolve()),
            world=world,
            start=start,
            strategy=strategy,
            mode=mode,
            pose=pose,
            seed=seed,
            sensor="reference" if args.reference_sensor else "configured",
            overrides=tuple(args.overrides),
        )
        for world, start, strategy, mode, pose, seed in itertools.product(
            worlds, starts, strategies, modes, poses, range(args.seeds)
        )
    ]


def _chosen(option: str, text: str, known: object) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if known is None and not name.isdigit():
            raise SystemExit(f"{option} {name}: not a number")
        if known is not None and name not in known:  # type: ignore[operator]
            raise SystemExit(f"{option} {name}: unknown; one of {', '.join(known)}")  # type: ignore[call-overload]
    if not names:
        raise SystemExit(f"{option}: empty")
    return names


if __name__ == "__main__":
    raise SystemExit(main())
