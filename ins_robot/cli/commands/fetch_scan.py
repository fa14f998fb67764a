# SPDX-License-Identifier: MIT
"""`ins-robot scan`: one scan as a polar plot, to stdout or `-o FILE`."""

from __future__ import annotations

import argparse
from pathlib import Path

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.cli.output_file import check_output, deliver
from ins_robot.daemon.control_protocol import decode_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write the PNG here, not to stdout"
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Take the scan and write its picture."""
    check_output(args.output, "scan", "PNG")
    deliver(decode_file(request(args, "scan")), args.output)
    return 0
