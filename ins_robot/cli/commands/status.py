# SPDX-License-Identifier: MIT
"""`ins-robot status`: what the robot is doing, as lines for people or JSON for programs."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the status."""
    status = request(args, "status")
    if args.json:
        print(json.dumps(status, indent=2))
    else:
        print("\n".join(status_lines(status)))
    return 0


def status_lines(status: Mapping[str, Any]) -> list[str]:
    """One line per entry, names aligned; an object within an object is spelled `a.b`."""
    rows = _flat(status, "")
    width = max((len(name) for name, _ in rows), default=0)
    return [f"{name:<{width}}  {text}".rstrip() for name, text in rows]


def _flat(values: Mapping[str, Any], prefix: str) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{name}.")
        else:
            rows.append((prefix + name, _text(value)))
    return rows


def _text(value: Any) -> str:
    if value is None or value == "":
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3f}".rstrip("0").rstrip(".")
    if isinstance(value, list):
        return " ".join(_text(item) for item in value) or "-"
    return str(value)
