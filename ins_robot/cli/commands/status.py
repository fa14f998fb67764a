# SPDX-License-Identifier: MIT
"""`ins-robot status`: what the robot is doing, as lines for people or JSON for programs."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping
from typing import Any

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.cli.left_unseen import left_words


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="one JSON object on stdout")
    form.add_argument(
        "--verbose", action="store_true", help="all of it: tasks, rates, times, the last run"
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the status."""
    status = request(args, "status")
    if args.json:
        print(json.dumps(status, indent=2))
    else:
        print("\n".join(aligned(_flat(status, "") if args.verbose else outline(status))))
    return 0


def aligned(rows: list[tuple[str, str]]) -> list[str]:
    """One line for each name and text, names aligned."""
    width = max((len(name) for name, _ in rows), default=0)
    return [f"{name:<{width}}  {text}".rstrip() for name, text in rows]


def outline(status: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a person asks first; rows that the daemon knows nothing of are left out."""
    rows = [("state", str(status["state"])), ("run", _text(status.get("run")))]
    if status.get("paused_because"):
        rows.append(("paused", status["paused_because"]))
    pose = status.get("pose")
    if pose is not None:
        heading = pose.get("heading_rad")
        degrees = None if heading is None else math.degrees(heading)
        rows.append(("pose", f"{_place(pose)}, heading {_figure(degrees, '.0f')} deg"))
    if "scans" in status:
        rows.append(("scans", f"{status['scans']}, and {status.get('sweeps')} sweeps"))
        way, time = status.get("path_length_m"), status.get("duration_s")
        rows.append(("way", f"{_figure(way, '.1f')} m in {_figure(time, '.0f')} s"))
    if status.get("goal"):
        goal = status["goal"]
        rows.append(("goal", f"{_place(goal)}; `ins-robot next` tells why"))
    if status.get("battery_v") is not None:
        rows.append(("battery", f"{status['battery_v']:.1f} V"))
    rows.append(("faults", "; ".join(_faults(status)) or "none"))
    rows += [("devices", missing) for missing in _missing(status) or ["all there"]]
    last = status.get("last_run")
    if last is not None and status.get("run") is None:
        left = left_words(last)
        told = f"{last['name']}, {last['state']}: {last['reason']}"
        rows.append(("last run", told + (f"; {left}" if left else "")))
    if status.get("last_goto"):
        rows.append(("last goto", status["last_goto"]))
    return rows


def _faults(status: Mapping[str, Any]) -> list[str]:
    stale = status.get("health", {}).get("stale", ())
    silent = [f"silent: {' '.join(stale)}"] if stale else []
    return list(filter(None, (status.get("stop"), status.get("fault"), *silent)))


def _missing(status: Mapping[str, Any]) -> list[str]:
    tasks = status.get("tasks", {})
    errors = {
        name: tasks.get(name, {}).get("last_error", "") for name in status.get("missing", ())
    }
    return [
        f"missing {name}: {error.removeprefix(f'{name}: ') or 'not opened yet'}"
        for name, error in errors.items()
    ]


def _place(pose: Mapping[str, Any]) -> str:
    return f"x {_figure(pose.get('x_m'), '.2f')} m, y {_figure(pose.get('y_m'), '.2f')} m"


def _figure(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _flat(values: Mapping[str, Any], prefix: str) -> list[tuple[str, str]]:
    """A row for each entry; an object within an object is spelled `a.b`."""
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
