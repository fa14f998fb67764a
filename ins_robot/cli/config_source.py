# SPDX-License-Identifier: MIT
"""Which configuration a command reads.

`--config F`, else $INS_ROBOT_CONFIG, else /etc/ins-robot/config.toml, else the defaults.

The working directory is not searched: a command must not change its robot with the directory it
is called from.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from pathlib import Path

from ins_robot.config import Config, load
from ins_robot.errors import ConfigError

ENVIRONMENT_VARIABLE = "INS_ROBOT_CONFIG"
SYSTEM_FILE = Path("/etc/ins-robot/config.toml")


def add_config_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--config F`."""
    parser.add_argument(
        "--config",
        metavar="F",
        type=Path,
        default=argparse.SUPPRESS,
        help=f"configuration file (default: ${ENVIRONMENT_VARIABLE}, {SYSTEM_FILE}, defaults)",
    )


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--set section.key=value`, repeatable; `args.overrides` is the list."""
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="SECTION.KEY=VALUE",
        action="append",
        default=[],
        help="change one option, e.g. --set lrf.rpm=250 (repeatable)",
    )


def find_config(
    explicit: Path | None,
    environment: Mapping[str, str] = os.environ,
    system_file: Path = SYSTEM_FILE,
) -> Path | None:
    """The configuration file to read; None means defaults. One that is named must exist."""
    if explicit is not None:
        return explicit
    if environment.get(ENVIRONMENT_VARIABLE):
        return Path(environment[ENVIRONMENT_VARIABLE])
    return system_file if system_file.exists() else None


def load_config(args: argparse.Namespace) -> Config:
    """The configuration that `--config`, the environment and `--set` ask for."""
    explicit: Path | None = getattr(args, "config", None)
    path = find_config(explicit)
    try:
        return load(path, getattr(args, "overrides", ()))
    except ConfigError as error:
        if explicit is None and path == Path(os.environ.get(ENVIRONMENT_VARIABLE, "")):
            raise ConfigError(f"${ENVIRONMENT_VARIABLE}: {error}") from None
        raise
