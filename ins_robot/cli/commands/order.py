# SPDX-License-Identifier: MIT
"""`ins-robot stop | pause | resume | estop | clear`: orders without arguments.

`stop` prints the name of the run that ended, and says when its map is blank; the others print
nothing when they have worked.
"""

from __future__ import annotations

import argparse
import sys

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Give the order that the command is called."""
    result = request(args, args.command)
    if result is not None:
        print(result)
        runs = {run["name"]: run for run in request(args, "runs")}
        if runs.get(result, {}).get("scans") == 0:
            print(f"{result} ended before its first scan: its map is blank", file=sys.stderr)
    return 0
