# SPDX-License-Identifier: MIT
"""A map on disk as ROS map_server writes it: a small YAML file and the image it names.

`parse` reads the subset of YAML these files use (`key: value`, lists in brackets or one `- item`
a line, comments, quotes). `read_is_free` reads the image. Own extension: `start: [x, y, deg]`,
where the robot is set down. Keys that are not known are left alone: the files are often foreign.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from ins_robot.errors import InputError

MAX_CELLS = 40_000_000
"""300 m x 300 m at 0.05 m; more would not fit beside the rest in a Pi's memory."""
MODES = ("trinary", "scale", "raw")
_RAW_FULL = 100.0
"""Mode raw: the pixel is the occupancy in per cent, 255 unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapDescription:
    """What the YAML file says. `start` is (x_m, y_m, heading_rad)."""

    image: str
    resolution_m: float
    origin_m: tuple[float, float] = (0.0, 0.0)
    is_negated: bool = False
    free_thresh: float = 0.196
    mode: str = "trinary"
    start: tuple[float, float, float] | None = None


def load_description(path: Path) -> MapDescription:
    """Read and parse a YAML file; InputError says what is wrong with it."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such world file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory, not a world's YAML file") from None
    except PermissionError:
        raise InputError(f"{path}: may not be read by this user") from None
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: not text; a world is the YAML file beside its image, not the image"
        ) from None
    return parse(text, str(path))


def parse(text: str, where: str) -> MapDescription:
    """Turn the text of a YAML file into a description; `where` names it in messages."""
    table = _read_table(text, where)
    for key in ("image", "resolution"):
        if not table.get(key):
            raise InputError(
                f"{where}: '{key}:' is missing; not a map_server world description"
            )
    resolution = _number(table["resolution"], "resolution", where)
    if not resolution > 0.0:
        raise InputError(f"{where}: resolution = {resolution:g} m: must be above 0")
    origin = _numbers(table.get("origin", "[0, 0, 0]"), "origin", where, (2, 3))
    if origin[2:] not in ([], [0.0]):
        raise InputError(f"{where}: origin turned by {origin[2]:g} rad: only 0 is supported")
    free_thresh = _number(table.get("free_thresh", "0.196"), "free_thresh", where)
    if not 0.0 < free_thresh <= 1.0:
        raise InputError(f"{where}: free_thresh = {free_thresh:g}: must be in (0, 1]")
    mode = table.get("mode", "trinary")
    if mode not in MODES:
        raise InputError(f"{where}: mode = {mode}: must be one of {', '.join(MODES)}")
    start = None
    if "start" in table:
        values = [*_numbers(table["start"], "start", where, (2, 3)), 0.0]
        start = (values[0], values[1], math.radians(values[2]))
    return MapDescription(
        image=table["image"],
        resolution_m=resolution,
        origin_m=(origin[0], origin[1]),
        is_negated=table.get("negate", "0").lower() in ("1", "true", "yes"),
        free_thresh=free_thresh,
        mode=mode,
        start=start,
    )


def read_is_free(description: MapDescription, path: Path) -> NDArray[np.bool_]:
    """(H, W) bool, row 0 at the bottom: the cells known to be free in the image `path`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(path)
        with image:
            if image.width * image.height > MAX_CELLS:
                raise InputError(_too_large(path, f"{image.width} x {image.height} cells"))
            pixels = np.asarray(image.convert("LA"), dtype=np.float64)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise InputError(_too_large(path, "over 80 million cells")) from None
    except FileNotFoundError:
        raise InputError(f"{path}: the world's image is missing") from None
    except UnidentifiedImageError:
        raise InputError(f"{path}: not an image (PGM or PNG expected)") from None
    except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises on broken files
        raise InputError(f"{path}: image is cut off or damaged: {error}") from None
    grey, is_opaque = pixels[::-1, :, 0], pixels[::-1, :, 1] > 0
    if description.mode == "raw":
        return is_opaque & (grey < _RAW_FULL * description.free_thresh)
    occupancy = (grey if description.is_negated else 255.0 - grey) / 255.0
    return is_opaque & (occupancy < description.free_thresh)


def _too_large(path: Path, size: str) -> str:
    return (
        f"{path}: {size}: a world may have {MAX_CELLS:,}; crop it or use a coarser resolution"
    )


def _read_table(text: str, where: str) -> dict[str, str]:
    """Keys with their raw text; a list of one `- item` a line becomes a bracketed one."""
    table: dict[str, str] = {}
    blocks: dict[str, list[str]] = {}
    key = ""
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split(" #")[0].strip()
        if not content or content.startswith(("#", "---", "%")):
            continue
        if key and content.startswith("- "):
            blocks.setdefault(key, []).append(content[2:])
            continue
        name, colon, value = content.partition(":")
        if not colon or line[0].isspace():
            raise InputError(f"{where}: line {number}: '{content[:40]}' is not 'key: value'")
        key = name.strip()
        table[key] = value.strip().strip("\"'")
    return table | {name: f"[{', '.join(items)}]" for name, items in blocks.items()}


def _numbers(text: str, key: str, where: str, counts: tuple[int, ...]) -> list[float]:
    items = text.strip("[]").split(",")
    if text[:1] != "[" or len(items) not in counts:
        raise InputError(f"{where}: {key} = {text}: expected a list like [0.0, 0.0, 0.0]")
    return [_number(item, key, where) for item in items]


def _number(text: str, key: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: {key} = {text.strip()}: not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {key} = {text.strip()}: must be finite")
    return value
