# SPDX-License-Identifier: MIT
"""`ins-robot goto X Y`: drive to a place of the map, within a run or after one."""

from __future__ import annotations

import argparse
import math

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("x_m", metavar="X", type=metres, help="metres; a run starts at 0 0")
    parser.add_argument("y_m", metavar="Y", type=metres, help="metres")
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Ask; an error says why the place cannot be reached."""
    request(args, "goto", x_m=args.x_m, y_m=args.y_m)
    return 0


def metres(text: str) -> float:
    """A finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text}: must be finite")
    return value
