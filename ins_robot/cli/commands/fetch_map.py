# SPDX-License-Identifier: MIT
"""`ins-robot map`: the map as a file, to stdout or `-o FILE`.

`ssh pi ins-robot map > map.png` works: without FILE the bytes go to stdout, unless that is a
terminal and they are binary.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from pathlib import Path

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.cli.output_file import check_output, deliver, write_whole
from ins_robot.daemon.control_protocol import MAP_FORMATS, decode_file
from ins_robot.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write here instead of to stdout"
    )
    parser.add_argument(
        "--format",
        choices=MAP_FORMATS,
        help="a picture, or one of the two files of ROS map_server "
        "(default: what the name of FILE ends in, else png); NAME.yaml gets NAME.pgm beside it",
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Fetch the map and write it."""
    output: Path | None = args.output
    wanted = format_for(output, args.format)
    if wanted == "yaml" and output is not None:
        description, image = _both_files(args)
        beside = output.with_suffix(".pgm")
        if beside.is_file():
            print(f"{beside}: replaces the file there", file=sys.stderr)
        write_whole(beside, image)
        deliver(description.replace(b"map.pgm", _scalar(beside.name), 1), output)
        return 0
    if wanted != "yaml":
        check_output(output, "map", wanted.upper())
    deliver(decode_file(request(args, "map", format=wanted)), output)
    return 0


def format_for(output: Path | None, asked: str | None) -> str:
    """The format that `--format` and the name's ending agree on; png when neither tells.

    Raises
    ------
    InputError
        When they contradict one another, or the ending is none of a map.
    """
    ending = "" if output is None else output.suffix.lower().removeprefix(".")
    known = " ".join(f".{name}" for name in MAP_FORMATS)
    if ending in MAP_FORMATS and asked not in (None, ending):
        raise InputError(f"map: --format {asked} and -o {output}: the ending says {ending}")
    if ending and ending not in MAP_FORMATS and asked is None:
        raise InputError(f"map: -o {output}: a map ends in {known}; or say --format")
    return asked or ending or "png"


def _scalar(name: str) -> bytes:
    """A file name as YAML; in double quotes, as JSON has them, unless it is plain."""
    is_plain = re.fullmatch(r"\w[\w.-]*", name) is not None
    return os.fsencode(name if is_plain else json.dumps(name, ensure_ascii=False))


def _both_files(args: argparse.Namespace) -> tuple[bytes, bytes]:
    """YAML and image of one state of the map, which may grow between two requests."""
    description = decode_file(request(args, "map", format="yaml"))
    while True:
        image = decode_file(request(args, "map", format="pgm"))
        before, description = description, decode_file(request(args, "map", format="yaml"))
        if description == before:
            return description, image
