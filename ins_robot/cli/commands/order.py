# SPDX-License-Identifier: MIT
"""`ins-robot stop | pause | resume | estop | clear`: orders without arguments.

`stop` prints the name of the run that ended; the others print nothing when they have worked.
"""

from __future__ import annotations

import argparse

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
    return 0
