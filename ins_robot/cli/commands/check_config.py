# SPDX-License-Identifier: MIT
"""`ins-robot check-config`: whether a configuration is usable, and what it amounts to."""

from __future__ import annotations

import argparse
from pathlib import Path

from ins_robot.cli.config_source import (
    add_config_argument,
    add_set_argument,
    find_config,
    load_config,
)
from ins_robot.config import reference_toml, to_toml
from ins_robot.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="default: what the daemon reads"
    )
    output = parser.add_mutually_exclusive_group()
    output.add_argument(
        "--print", action="store_true", dest="is_printed", help="print the options in effect"
    )
    output.add_argument(
        "--reference",
        action="store_true",
        help="print the commented reference: every option, default, bounds and reason",
    )
    add_config_argument(parser)
    add_set_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Check; a ConfigError says what is wrong."""
    if args.reference:
        print(reference_toml(), end="")
        return 0
    if args.file is not None:
        if hasattr(args, "config"):
            raise InputError(f"--config {args.config} and {args.file}: one file at a time")
        args.config = args.file
    config = load_config(args)
    if args.is_printed:
        print(to_toml(config), end="")
    else:
        print(f"{find_config(getattr(args, 'config', None)) or 'defaults'}: ok")
    return 0
