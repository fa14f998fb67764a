# SPDX-License-Identifier: MIT
"""`ins-robot start`: begin a run; prints its name."""

from __future__ import annotations

import argparse
import sys

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--name",
        default="",
        metavar="N",
        help="what to call the run; its directory is NUMBER-N (default: run)",
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Ask for a run."""
    given = request(args, "start", name=args.name)
    print(given)
    if args.name and not given.endswith(f"-{args.name}"):
        print(
            f"'{args.name}' is called {given}: a name has letters, digits, - and _, at most 64",
            file=sys.stderr,
        )
    return 0
