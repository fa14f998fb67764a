# SPDX-License-Identifier: MIT
"""A map as ROS map_server and nav2 take it: a PGM image and a YAML file, as bytes and text.

The image's first row is the top of the map (largest y); white is free, black occupied, grey
unknown. `read_map` is the inverse of `pgm_bytes` with `yaml_text`; callers do the file work.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ins_robot.errors import InputError

FREE, UNKNOWN, OCCUPIED = 254, 205, 0  # what map_saver writes
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196  # map_saver's; 205 lies between, so stays unknown
CELLS_MAX = 100_000_000
_MAXVAL = 255
_DIGITS_MAX = 9
_KNOWN_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")

BoolArray = NDArray[np.bool_]


class GridView(Protocol):
    """What is drawn and saved of a grid: an `OccupancyGrid` or a `TernaryMap`.

    Row r, column c covers the square whose lower left corner is
    `origin_m + (c, r) * resolution_m`: rows grow with +y.
    """

    @property
    def resolution_m(self) -> float:
        """Cell size."""
        ...

    @property
    def origin_m(self) -> tuple[float, float]:
        """Lower left corner of cell (0, 0)."""
        ...

    @property
    def is_occupied(self) -> BoolArray:
        """(H, W)."""
        ...

    @property
    def is_free(self) -> BoolArray:
        """(H, W)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class TernaryMap:
    """A finished map: cells (H, W) that are occupied, free, or neither (unknown)."""

    resolution_m: float
    origin_m: tuple[float, float]
    is_occupied: BoolArray
    is_free: BoolArray

    @staticmethod
    def of(grid: GridView) -> TernaryMap:
        """A copy of what `grid` knows now."""
        x_m, y_m = grid.origin_m
        return TernaryMap(
            resolution_m=float(grid.resolution_m),
            origin_m=(float(x_m), float(y_m)),
            is_occupied=np.array(grid.is_occupied, dtype=bool),
            is_free=np.array(grid.is_free, dtype=bool),
        )

    def cropped(self, margin_cells: int) -> TernaryMap:
        """The part that holds all known cells, with a margin (filled up with unknown).

        A map that knows nothing becomes the margin around one unknown cell.
        """
        known = self.is_occupied | self.is_free
        rows = np.flatnonzero(known.any(axis=1))
        cols = np.flatnonzero(known.any(axis=0))
        return self.window(
            (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 1),
            (int(cols[0]), int(cols[-1]) + 1) if len(cols) else (0, 1),
            margin_cells,
        )

    def window(
        self, rows: tuple[int, int], cols: tuple[int, int], margin_cells: int
    ) -> TernaryMap:
        """Cells [from, to) of `rows` and `cols`, with a margin of unknown cells around them."""
        inside = (slice(*rows), slice(*cols))
        x_m, y_m = self.origin_m
        return TernaryMap(
            resolution_m=self.resolution_m,
            origin_m=(
                x_m + (cols[0] - margin_cells) * self.resolution_m,
                y_m + (rows[0] - margin_cells) * self.resolution_m,
            ),
            is_occupied=np.pad(self.is_occupied[inside], margin_cells),
            is_free=np.pad(self.is_free[inside], margin_cells),
        )


def pgm_bytes(grid: GridView) -> bytes:
    """The image: binary PGM (P5), one byte a cell."""
    height, width = grid.is_free.shape
    pixels = np.full((height, width), UNKNOWN, dtype=np.uint8)
    pixels[grid.is_free] = FREE
    pixels[grid.is_occupied] = OCCUPIED
    return b"P5\n%d %d\n%d\n" % (width, height, _MAXVAL) + pixels[::-1].tobytes()


def yaml_text(grid: GridView, image_name: str) -> str:
    """The description that map_server reads beside the image."""
    x_m, y_m = grid.origin_m
    return (
        f"image: {image_name}\n"
        "mode: trinary\n"
        f"resolution: {float(grid.resolution_m)!r}\n"
        f"origin: [{float(x_m)!r}, {float(y_m)!r}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapDescription:
    """The YAML file's content; `others` holds the raw values of keys not named here."""

    image: str
    resolution_m: float
    origin_m: tuple[float, float]
    is_negated: bool
    occupied_thresh: float
    free_thresh: float
    others: Mapping[str, str]


def read_description(text: str, where: str) -> MapDescription:
    """Read the YAML of a map: the flat `key: value` lines that map_server knows.

    Raises
    ------
    InputError
        With the line number, when a key is missing or a value cannot be used.
    """
    found: dict[str, tuple[int, str]] = {}
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split(" #")[0].strip()
        if not line or line.startswith(("#", "---")):
            continue
        key, colon, value = line.partition(":")
        if not colon:
            raise InputError(f"{where}:{number}: '{line[:40]}' is not 'key: value'")
        found[key.strip()] = (number, value.strip())

    def numbers(key: str, count: int, default: str | None = None) -> list[float]:
        number, value = _lookup(found, key, default, where)
        parts = value.strip("[] ").split(",")
        try:
            values = [float(part) for part in parts]
        except ValueError:
            values = []
        if len(values) != count or not all(math.isfinite(v) for v in values):
            raise InputError(
                f"{where}:{number}: {key}: {value} must be {count} finite number(s)"
            )
        return values

    resolution_m = numbers("resolution", 1)[0]
    if resolution_m <= 0.0:
        raise InputError(f"{where}: resolution: {resolution_m:g} m must be above 0")
    x_m, y_m, yaw_rad = numbers("origin", 3)
    if yaw_rad != 0.0:
        raise InputError(
            f"{where}: origin: a map turned by {yaw_rad:g} rad cannot be used, only 0"
        )
    return MapDescription(
        image=_lookup(found, "image", None, where)[1].strip("'\""),
        resolution_m=resolution_m,
        origin_m=(x_m, y_m),
        is_negated=numbers("negate", 1, "0")[0] != 0.0,
        occupied_thresh=numbers("occupied_thresh", 1, str(OCCUPIED_THRESH))[0],
        free_thresh=numbers("free_thresh", 1, str(FREE_THRESH))[0],
        others={key: value for key, (_, value) in found.items() if key not in _KNOWN_KEYS},
    )


def _lookup(
    found: dict[str, tuple[int, str]], key: str, default: str | None, where: str
) -> tuple[int, str]:
    if key in found:
        return found[key]
    if default is None:
        raise InputError(f"{where}: no line '{key}: ...'; is this the YAML file of a map?")
    return 0, default


def read_pgm(data: bytes, where: str) -> NDArray[np.uint8]:
    """Pixels (H, W) of a binary PGM of 8 bits, first row = top.

    Raises
    ------
    InputError
        When it is another kind of image, cut off, or too large.
    """
    if not data.startswith(b"P5"):
        raise InputError(f"{where}: not a binary PGM image (it does not begin with P5)")
    values: list[int] = []
    at = 2
    while len(values) < 3:  # noqa: PLR2004 - width, height, maxval
        while data[at : at + 1].isspace():
            at += 1
        if data[at : at + 1] == b"#":
            at = data.find(b"\n", at) % (len(data) + 1)
            continue
        end = at
        while data[end : end + 1].isdigit():
            end += 1
        if not 0 < end - at <= _DIGITS_MAX:
            raise InputError(f"{where}: the header of the PGM image is damaged or cut off")
        values.append(int(data[at:end]))
        at = end
    width, height, maxval = values
    if maxval != _MAXVAL:
        raise InputError(f"{where}: maximum grey value {maxval}, only {_MAXVAL} can be read")
    if not 0 < width * height <= CELLS_MAX:
        raise InputError(f"{where}: {width} x {height} cells; 1 to {CELLS_MAX} can be read")
    pixels = data[at + 1 : at + 1 + width * height]
    if len(pixels) < width * height:
        raise InputError(
            f"{where}: cut off: {len(pixels)} of {width * height} pixels; copy the file again"
        )
    return np.frombuffer(pixels, dtype=np.uint8).reshape(height, width)


def read_map(pgm: bytes, yaml: str, where: str = "map") -> TernaryMap:
    """A map back from its two files."""
    description = read_description(yaml, where)
    pixels = read_pgm(pgm, where)[::-1].astype(np.float64)
    # map_server: occupancy = (255 - pixel) / 255, or pixel / 255 when negated.
    occupancy = (pixels if description.is_negated else _MAXVAL - pixels) / _MAXVAL
    return TernaryMap(
        resolution_m=description.resolution_m,
        origin_m=description.origin_m,
        is_occupied=occupancy > description.occupied_thresh,
        is_free=occupancy < description.free_thresh,
    )
