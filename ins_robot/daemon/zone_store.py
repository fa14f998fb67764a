# SPDX-License-Identifier: MIT
"""The file of no-go zones and virtual walls beside the runs; each run begins with them.

They are in the frame of the map, whose origin is where a run begins: they hold for runs that
begin at the same place, which is where a robot stands that has come home.
"""

from __future__ import annotations

import json
from pathlib import Path

from ins_robot.errors import InputError
from ins_robot.logs.run_directory import json_bytes, write_atomically
from ins_robot.mapping.zones import ZONES_FILE, Zone, zones_as_json, zones_of


def read_zones(path: Path) -> tuple[Zone, ...]:
    """The zones in a file. Raises InputError when it is none of ours."""
    try:
        return zones_of(json.loads(path.read_bytes()))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(
            f"{path}: is no zones.json, as `ins-robot zones add` writes it: {error}"
        ) from None


class ZoneStore:
    """Zones in `root`/zones.json."""

    def __init__(self, root: Path) -> None:
        self._path = root / ZONES_FILE

    def load(self) -> tuple[Zone, ...]:
        """All of them. Raises InputError when the file is none of ours."""
        return read_zones(self._path) if self._path.exists() else ()

    def add(self, zone: Zone) -> tuple[Zone, ...]:
        """One more, whose name must be new; all of them."""
        return self._save(zones_of(zones_as_json([*self.load(), zone])))

    def remove(self, name: str) -> tuple[Zone, ...]:
        """One less; those that are left. Raises InputError when there is none of that name."""
        zones = self.load()
        kept = tuple(zone for zone in zones if zone.name != name)
        if len(kept) == len(zones):
            known = ", ".join(zone.name for zone in zones) or "there are none"
            raise InputError(f"no zone '{name}'; known: {known}")
        return self._save(kept)

    def _save(self, zones: tuple[Zone, ...]) -> tuple[Zone, ...]:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._path, json_bytes(zones_as_json(zones)))
        return zones
