# SPDX-License-Identifier: MIT
"""`ins-robot stop | pause | resume | estop | clear`: orders without arguments.

`stop` prints the name of the run that ended, and says when its map is blank; the others print
nothing when they have worked.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from typing import Any

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.errors import RobotError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Give the order that the command is called."""
    result = request(args, args.command)
    if result is not None:
        print(result)
        with contextlib.suppress(RobotError):  # the order itself has worked
            _tell_blank(result, request(args, "runs"))
    return 0


def _tell_blank(name: str, runs: list[dict[str, Any]]) -> None:
    if any(run["name"] == name and run.get("scans") == 0 for run in runs):
        print(f"{name} ended before its first scan: its map is blank", file=sys.stderr)
