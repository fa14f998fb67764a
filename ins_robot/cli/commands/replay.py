# SPDX-License-Identifier: MIT
"""`ins-robot replay`: the map, once more, of what was recorded."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ins_robot.cli.config_source import add_config_argument, add_set_argument, load_config


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "log",
        type=Path,
        metavar="LOG|DIR",
        help="a recording (run directory or journal), a CARMEN log, a Botvac CSV, "
        "or the LEGO directory; told by content",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="where the run's files go"
    )
    add_config_argument(parser)
    add_set_argument(parser)
    parser.add_argument(
        "--no-odometry", action="store_true", help="scans alone, as if there were no wheels"
    )
    parser.add_argument(
        "--every",
        type=_positive,
        default=1,
        metavar="N",
        help="take every Nth scan only (odometry is kept)",
    )
    parser.add_argument(
        "--fov",
        type=_degrees,
        metavar="DEG",
        help="what the beams of FLASER lines span, when not 180 degrees",
    )
    parser.add_argument("--json", action="store_true", help="print summary.json")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def _degrees(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 360.0:  # noqa: PLR2004 - a full turn
        raise argparse.ArgumentTypeError("must be above 0 and at most 360")
    return value


def run(args: argparse.Namespace) -> int:
    """Replay, write the files, say where they are."""
    import time

    import numpy as np

    from ins_robot.logs.open_log import find_log, read_log
    from ins_robot.logs.replay import replay_log
    from ins_robot.logs.run_directory import MAP_PNG, json_bytes, prepare_directory, write_run

    config = load_config(args)
    kind, path = find_log(args.log)
    log = read_log(kind, path, args.fov)
    if args.no_odometry:
        log = log.without_odometry()
    log = log.with_every(args.every)
    prepare_directory(args.out)
    meter = ProgressLine(f"replay {args.log.name}")
    result = replay_log(
        log,
        config,
        args.log.resolve().stem,
        np.random.default_rng(config.slam.seed),
        time.perf_counter,
        meter.show,
    )
    meter.clear()
    summary = write_run(args.out, result)
    if args.json:
        print(json_bytes(summary).decode(), end="")
    else:
        print(args.out / MAP_PNG)
    return 0


class ProgressLine:
    """One line on stderr that says how far the work is; silent when that is no terminal."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._shown = -1
        self._is_terminal = sys.stderr.isatty()

    def show(self, share: float) -> None:
        """Rewrite the line when the whole percent has changed."""
        percent = int(100.0 * share)
        if self._is_terminal and percent != self._shown:
            self._shown = percent
            print(f"\r{self._what}: {percent:3d} %", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Remove the line."""
        if self._is_terminal and self._shown >= 0:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
