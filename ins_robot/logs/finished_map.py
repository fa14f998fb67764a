# SPDX-License-Identifier: MIT
"""A finished map from disk: a run's directory, or the YAML file of any ROS map_server map."""

from __future__ import annotations

from pathlib import Path

from ins_robot.errors import InputError
from ins_robot.logs.run_directory import MAP_YAML
from ins_robot.mapping.map_files import TernaryMap, read_description, read_map


def read_finished_map(path: Path) -> TernaryMap:
    """The map at `path`.

    Raises
    ------
    InputError
        If there is none, it cannot be read, or it shows no wall or no free cell.
    """
    where = path / MAP_YAML if path.is_dir() else path
    try:
        text = where.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{where}: no such map; give a map.yaml or a run directory") from None
    except UnicodeDecodeError:
        raise InputError(
            f"{where}: not text; give the map's YAML file, not its image"
        ) from None
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from None
    description = read_description(text, str(where))
    if description.others.get("mode") == "raw":
        raise InputError(f"{where}: mode: raw cannot be read, only trinary and scale")
    image = where.parent / description.image
    try:
        pixels = image.read_bytes()
    except OSError as error:
        raise InputError(f"{image}: the map's image cannot be read: {error.strerror}") from None
    grid = read_map(pixels, text, str(image))
    for cells, what in ((grid.is_occupied, "occupied"), (grid.is_free, "free")):
        if not cells.any():
            raise InputError(
                f"{image}: no {what} cell, so nothing can be found on it; "
                "check negate and the thresholds"
            )
    return grid
