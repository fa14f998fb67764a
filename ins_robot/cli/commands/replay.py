# SPDX-License-Identifier: MIT
"""`ins-robot replay`: the map, once more, of what was recorded."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ins_robot.cli.config_source import add_config_argument, add_set_argument, load_config
from ins_robot.cli.interrupts import Interrupts
from ins_robot.errors import InputError

if TYPE_CHECKING:
    from ins_robot.core.run_result import RunResult
    from ins_robot.logs.open_log import LogKind


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
        type=positive,
        default=1,
        metavar="N",
        help="take every Nth scan only (odometry is kept)",
    )
    add_fov_argument(parser)
    parser.add_argument("--json", action="store_true", help="print summary.json")


def add_fov_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--fov DEG`, which CARMEN's `FLASER` lines do not tell."""
    parser.add_argument(
        "--fov",
        type=_degrees,
        metavar="DEG",
        help="what the beams of FLASER lines span, when not 180 degrees",
    )


def positive(text: str) -> int:
    """A whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number of at least 1")
    return int(text)


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 360.0:  # noqa: PLR2004 - a full turn
        raise argparse.ArgumentTypeError(f"{text!r}: must be above 0 and at most 360")
    return value


def run(args: argparse.Namespace) -> int:
    """Replay, write the files, say where they are."""
    from ins_robot.daemon.drawing import draw_elsewhere
    from ins_robot.logs.open_log import LogKind, find_log
    from ins_robot.logs.run_directory import MAP_PNG, json_bytes, prepare_directory, write_run

    kind, path = find_log(args.log)
    _check_out(args.out)
    meter = ProgressLine(f"replay {args.log.name}")
    replay = _recording if kind is LogKind.JOURNAL else _foreign_log
    with Interrupts() as interrupts:
        try:
            result = replay(args, kind, path, meter.show, interrupts.cut)
        finally:
            meter.clear()
        for loss in result.notes.get("recording_losses", ()):
            print(f"ins-robot: {path}: {loss}", file=sys.stderr)
        if prepare_directory(args.out):
            print(f"{args.out}: replaces the run there", file=sys.stderr)
        summary = write_run(args.out, result, draw_elsewhere)
    if args.json:
        print(json_bytes(summary).decode(), end="")
    else:
        print(describe(summary), file=sys.stderr)
        print(args.out / MAP_PNG)
    if interrupts.has_cut:
        print(f"interrupted; what was computed so far is in {args.out}", file=sys.stderr)
        raise KeyboardInterrupt
    return 0


def _check_out(out: Path) -> None:
    """Refuse where the files may not go, before the work; a recording keeps its own map."""
    from ins_robot.logs.journal import JOURNAL_NAME
    from ins_robot.logs.run_directory import holds_run

    if out.is_file():
        raise InputError(f"--out {out}: is a file, not a directory")
    if holds_run(out) and (out / JOURNAL_NAME).exists():
        raise InputError(
            f"--out {out}: a recorded run is there, whose files belong to its "
            f"{JOURNAL_NAME}; name another directory"
        )


def _foreign_log(
    args: argparse.Namespace,
    kind: LogKind,
    path: Path,
    progress: Callable[[float], None],
    is_stopped: Callable[[], bool],
) -> RunResult:
    """SLAM on what another robot recorded."""
    import numpy as np

    from ins_robot.logs.open_log import read_log
    from ins_robot.logs.replay import replay_log

    config = load_config(args)
    log = read_log(kind, path, args.fov)
    if args.no_odometry:
        log = log.without_odometry()
    log = log.with_every(args.every)
    name = args.log.resolve().stem
    rng = np.random.default_rng(config.slam.seed)
    return replay_log(log, config, name, rng, time.perf_counter, progress, is_stopped)


def _recording(
    args: argparse.Namespace,
    kind: LogKind,
    path: Path,
    progress: Callable[[float], None],
    is_stopped: Callable[[], bool],
) -> RunResult:
    """One of our own runs, computed again with the configuration it had."""
    from ins_robot.logs.replay_journal import JournalOptions, replay_journal

    for option in ("config", "fov"):
        if getattr(args, option, None) is not None:
            raise InputError(
                f"--{option}: {path} is {kind.value} and brings its own configuration; "
                "change single options with --set"
            )
    options = JournalOptions(
        overrides=args.overrides, use_odometry=not args.no_odometry, every=args.every
    )
    return replay_journal(path, options, time.perf_counter, progress, is_stopped)


def describe(summary: Mapping[str, Any]) -> str:
    """What a person wants to know of a replay, in one line."""
    loops = summary["loop_closures"]
    return (
        f"{summary['state']}: {summary['reason']}; "
        f"{summary['scans']} scan{'s' * (summary['scans'] != 1)}, {summary['nodes']} kept, "
        f"{summary['path_length_m']:.1f} m, {loops} loop{'s' * (loops != 1)} closed, "
        f"{summary['slam_ms_median']:.1f} ms a scan"
    )


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
