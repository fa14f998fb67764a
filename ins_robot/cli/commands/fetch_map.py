# SPDX-License-Identifier: MIT
"""`ins-robot map`: the map as a file, to stdout or `-o FILE`.

`ssh pi ins-robot map > map.png` works: without FILE the bytes go to stdout, unless that is a
terminal and they are binary.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.cli.output_file import check_output, deliver
from ins_robot.daemon.control_protocol import MAP_FORMATS, decode_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write here instead of to stdout"
    )
    parser.add_argument(
        "--format",
        choices=MAP_FORMATS,
        help="a picture, or one of the two files of ROS map_server "
        "(default: what the name of FILE ends in, else png)",
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Fetch the map and write it."""
    wanted = args.format or format_of(args.output)
    if wanted != "yaml":
        check_output(args.output, "map", wanted.upper())
    deliver(decode_file(request(args, "map", format=wanted)), args.output)
    return 0


def format_of(output: Path | None) -> str:
    """The format that the name of the output file asks for; a PNG when it does not tell."""
    suffix = "" if output is None else output.suffix.lower().removeprefix(".")
    return suffix if suffix in MAP_FORMATS else "png"
