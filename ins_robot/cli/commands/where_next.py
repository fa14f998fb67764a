# SPDX-License-Identifier: MIT
"""`ins-robot next`: where the run goes next, in words, as JSON, and on the map (`-o FILE`).

On the manual base that is where a person is to carry the LRF; elsewhere it tells the goal.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.cli.output_file import write_whole
from ins_robot.daemon.control_protocol import decode_file

AHEAD = "straight ahead"
STRAIGHT_DEG = 2.5  # less is not worth a word
DETOUR_M = 0.3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="also draw it on the map, a PNG"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument(
        "--skip",
        action="store_true",
        help="manual base: the place cannot be reached, name another",
    )
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Ask, print, and draw."""
    told = request(args, "skip" if args.skip else "next")
    if args.output is not None:
        write_whole(args.output, decode_file(request(args, "next_picture")))
    print(json.dumps(told, indent=2) if args.json else "\n".join(words(told)))
    return 0


def words(told: Mapping[str, Any]) -> list[str]:
    """The answer of `next` for people."""
    goal, state = told["goal"], told["state"]
    if goal is None and state == "waiting":
        return [
            "put the LRF down where the map shall begin, keep clear of it; `ins-robot here`"
        ]
    if goal is None:
        return [f"{state}: {told['reason']}" if told["reason"] else f"{state}: no goal yet"]
    where = f"{told['distance_m']:.2f} m {side(told['bearing_rad'])}"
    if told["way_m"] > told["distance_m"] + DETOUR_M:
        where += f" ({told['way_m']:.1f} m to walk)"
    turn = side(told["turn_rad"])
    facing = f"look {turn}" + ("" if turn == AHEAD else " of where the LRF looks now")
    if state != "waiting":
        return [f"{state}: goal {where}", *_in_the_map(told)]
    return [f"go {where}, then {facing}; stand behind it: `ins-robot here`", *_in_the_map(told)]


def _in_the_map(told: Mapping[str, Any]) -> list[str]:
    goal = told["goal"]
    heading = f"heading {math.degrees(goal['heading_rad']):.0f} deg"
    return [
        f"in the map: x {goal['x_m']:.2f} m, y {goal['y_m']:.2f} m, {heading}",
        f"why: {told['reason']}",
    ]


def side(angle_rad: float) -> str:
    """An angle as a person says it."""
    degrees = math.degrees(angle_rad)
    if abs(degrees) < STRAIGHT_DEG:
        return AHEAD
    return f"{abs(degrees):.0f} deg to the {'left' if degrees > 0.0 else 'right'}"
