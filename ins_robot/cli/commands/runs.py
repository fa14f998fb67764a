# SPDX-License-Identifier: MIT
"""`ins-robot runs`: list the recorded runs; `ins-robot runs delete NAME...` removes some."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--json", action="store_true", help="a JSON list on stdout")
    add_config_argument(parser)
    parser.usage = "ins-robot runs [-h] [--json] [--config F] [list | delete NAME ...]"
    actions = parser.add_subparsers(dest="action", metavar="ACTION", prog="ins-robot runs")
    listed = actions.add_parser(
        "list", help="the default", description="List the recorded runs.", allow_abbrev=False
    )
    listed.add_argument(
        "--json", action="store_true", default=argparse.SUPPRESS, help="as a JSON list"
    )
    add_config_argument(listed)
    delete = actions.add_parser(
        "delete",
        help="remove runs",
        description="Remove runs with all their files: all that are named, or none.",
        allow_abbrev=False,
    )
    delete.add_argument("names", nargs="+", metavar="NAME", help="as `ins-robot runs` lists it")
    add_config_argument(delete)


def run(args: argparse.Namespace) -> int:
    """List or delete."""
    if args.action == "delete":
        request(args, "delete_runs", names=args.names)
        return 0
    runs = request(args, "runs")
    print(json.dumps(runs, indent=2) if args.json else "\n".join(run_lines(runs)))
    return 0


def run_lines(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """A table, one run a line, oldest first."""
    if not runs:
        return ["no runs"]
    header = ("NAME", "STATE", "DURATION", "PATH", "SCANS", "SIZE")
    rows = [header] + [
        (
            str(run["name"]),
            str(run["state"]),
            _with_unit(run.get("duration_s"), "{:.0f} s"),
            _with_unit(run.get("path_length_m"), "{:.1f} m"),
            _with_unit(run.get("scans"), "{:d}"),
            _with_unit(run.get("size_mb"), "{:.1f} MB"),
        )
        for run in runs
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            [row[0].ljust(widths[0]), row[1].ljust(widths[1])]
            + [cell.rjust(width) for cell, width in zip(row[2:], widths[2:], strict=True)]
        )
        for row in rows
    ]


def _with_unit(value: Any, form: str) -> str:
    return "-" if value is None else form.format(value)
