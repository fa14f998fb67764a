# SPDX-License-Identifier: MIT
"""No-go zones and virtual walls: ground that people forbid, in the frame of the map.

A zone is a polygon that the body stays out of, a wall a line that it does not cross. JSON in,
`Zone`s out, and back; whoever gives one that cannot be is told in one line. Light on purpose:
the command line imports it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ins_robot.errors import InputError
from ins_robot.outline import COORDINATE_MAX_M, CORNERS_MAX, Corners, flaw_of

ZONES_FILE = "zones.json"
WALL_POINTS_MIN = 2


class ZoneKind(StrEnum):
    """What is forbidden."""

    NO_GO = "no-go"
    WALL = "wall"


@dataclass(frozen=True, slots=True, kw_only=True)
class Zone:
    """One of them: a polygon's corners, or the points of a wall, (x, y) in metres."""

    name: str
    kind: ZoneKind
    points_m: Corners

    def as_json(self) -> dict[str, Any]:
        """JSON values; `zone_of` reads them."""
        return {
            "name": self.name,
            "kind": str(self.kind),
            "points": [list(point) for point in self.points_m],
        }


def zone_of(value: Any) -> Zone:
    """The zone that a JSON object describes.

    Raises
    ------
    InputError
        One line: which zone, and what is wrong with it.
    """
    if not isinstance(value, dict) or not {"name", "kind", "points"} <= set(value):
        raise InputError('a zone must be {"name": ..., "kind": ..., "points": [[x, y], ...]}')
    name, kind, points = value["name"], value["kind"], value["points"]
    if not isinstance(name, str) or not name:
        raise InputError("a zone needs a name")
    if kind not in list(ZoneKind):  # a list: JSON may bring what cannot be hashed
        raise InputError(f"zone '{name}': kind must be one of {', '.join(ZoneKind)}")
    if not isinstance(points, list | tuple) or not all(map(_is_point, points)):
        raise InputError(
            f"zone '{name}': points must be pairs x y in metres from the start, "
            f"none beyond {COORDINATE_MAX_M:g} m"
        )
    corners = tuple((float(x), float(y)) for x, y in points)
    flaw = _flaw_of_wall(corners) if kind == ZoneKind.WALL else flaw_of(corners)
    if flaw is not None:
        raise InputError(f"zone '{name}': {flaw}")
    return Zone(name=name, kind=ZoneKind(kind), points_m=corners)


def zones_of(values: Any) -> tuple[Zone, ...]:
    """Several, with different names. Raises InputError as `zone_of` does."""
    if not isinstance(values, list | tuple):
        raise InputError("zones must be a list of zones")
    zones = tuple(map(zone_of, values))
    names = [zone.name for zone in zones]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"zone '{twice}': there is already one of that name")
    return zones


def zones_as_json(zones: Iterable[Zone]) -> list[dict[str, Any]]:
    """JSON values of several."""
    return [zone.as_json() for zone in zones]


def _is_point(point: Any) -> bool:
    return (
        isinstance(point, list | tuple)
        and len(point) == 2  # noqa: PLR2004 - x and y
        and all(isinstance(v, int | float) and abs(v) <= COORDINATE_MAX_M for v in point)
    )


def _flaw_of_wall(points_m: Corners) -> str | None:
    if len(set(points_m)) < WALL_POINTS_MIN:
        return f"{len(set(points_m))} points, a wall needs at least {WALL_POINTS_MIN}"
    if len(points_m) > CORNERS_MAX:
        return (
            f"{len(points_m)} points, at most {CORNERS_MAX} are allowed: leave out the finest"
        )
    return None
