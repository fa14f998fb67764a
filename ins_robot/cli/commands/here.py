# SPDX-License-Identifier: MIT
"""`ins-robot here`: the LRF stands at the place that `next` named; scan, and name the next.

Exit code 1 with one line when the scan fits nowhere in the map, which stays as it was.
"""

from __future__ import annotations

import argparse

from ins_robot.cli.commands.where_next import words
from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Take the scan and print where to go next."""
    print("\n".join(words(request(args, "here"))))
    return 0
