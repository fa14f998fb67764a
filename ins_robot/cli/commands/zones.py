# SPDX-License-Identifier: MIT
"""`ins-robot zones add | list | remove`: no-go zones and virtual walls, in the map's metres."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

from ins_robot.cli.commands.goto import metres
from ins_robot.cli.config_source import add_config_argument
from ins_robot.cli.control_client import request
from ins_robot.errors import InputError
from ins_robot.mapping.zones import ZoneKind, zone_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_config_argument(parser)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    add = actions.add_parser(
        "add",
        prog="ins-robot zones add",
        help="forbid a polygon, or crossing a line",
        description="Forbid the ground in a polygon, or crossing a line, in the run under way "
        "and all later ones.",
        allow_abbrev=False,
    )
    add.add_argument("kind", choices=list(map(str, ZoneKind)), help="polygon or line")
    add.add_argument("name", metavar="NAME", help="what to call it, for `zones remove`")
    add.add_argument(
        "numbers", metavar="X Y", type=metres, nargs="+", help="corners in metres; start: 0 0"
    )
    listed = actions.add_parser(
        "list",
        help="print them",
        description="Print all no-go zones and virtual walls, one a line.",
        allow_abbrev=False,
    )
    listed.add_argument("--json", action="store_true", help="a JSON list on stdout")
    remove = actions.add_parser(
        "remove",
        help="allow again",
        description="Allow again what a zone or wall forbids.",
        allow_abbrev=False,
    )
    remove.add_argument("name", metavar="NAME", help="as `ins-robot zones list` tells it")
    for action in (add, listed, remove):
        add_config_argument(action)


def run(args: argparse.Namespace) -> int:
    """Do it."""
    if args.action == "add":
        numbers = args.numbers
        if len(numbers) % 2:
            raise InputError(f"zone '{args.name}': {len(numbers)} numbers, need x y pairs")
        points = list(zip(numbers[::2], numbers[1::2], strict=True))
        zone = zone_of({"name": args.name, "kind": args.kind, "points": points})
        request(args, "add_zone", zone=zone.as_json())
    elif args.action == "remove":
        request(args, "remove_zone", name=args.name)
    else:
        zones = request(args, "zones")
        lines = [_line(zone) for zone in zones] or ["no zones"]
        print(json.dumps(zones, indent=2) if args.json else "\n".join(lines))
    return 0


def _line(zone: Mapping[str, Any]) -> str:
    points = " ".join(f"{x:g},{y:g}" for x, y in zone["points"])
    return f"{zone['kind']}  {zone['name']}  {points}"
