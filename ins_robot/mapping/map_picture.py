# SPDX-License-Identifier: MIT
"""The map as a picture for people: walls, the way driven, nodes, gaps, robot, scale bar.

In goes a grid and what to draw on it (all in the map frame), out come PNG bytes, the same for
the same input. Cells are scaled by a whole number, so walls stay crisp; what is drawn on top
is drawn at twice the size and scaled down, so lines stay smooth. Pillow is imported when used.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import GridView, TernaryMap

if TYPE_CHECKING:
    from PIL.Image import Image

LONG_SIDE_PX = 1200  # cells are scaled up to about this
WIDTH_MIN_PX = 640  # below this the footer has no room; unknown space is added
SCALE_MAX = 14
MARGIN_M = 0.4
SMOOTH = 2  # drawings are made this much larger

_UNKNOWN = (226, 229, 234)
_FREE = (255, 255, 255)
_OCCUPIED = (24, 32, 44)
_FOOTER = (255, 255, 255)
_INK = (51, 61, 77)
_RULE = (208, 213, 220)
_WAY = (46, 124, 214)
_LINK = (150, 190, 232)
_NODE = (17, 75, 145)
_START = (22, 150, 96)
_OPEN_GAP = (240, 130, 20)
_CLOSED_GAP = (148, 158, 172)
_ROBOT = (214, 40, 57)

_FOOTER_PX = 64
_TEXT_PX = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class GapMark:
    """A gap to be drawn: its ends (2, 2), and whether it is still to be explored."""

    ends_m: FloatArray
    is_open: bool


def _no_points() -> FloatArray:
    return np.zeros((0, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class MapPicture:
    """What is on the picture.

    `way_m` is (N, 2), `nodes_m` (K, 2), `links` pairs of rows of `nodes_m`. `robot` None: not
    drawn. `caption` is one short line.
    """

    grid: GridView
    way_m: FloatArray = field(default_factory=_no_points)
    nodes_m: FloatArray = field(default_factory=_no_points)
    links: Sequence[tuple[int, int]] = ()
    gaps: Sequence[GapMark] = ()
    robot: Pose2 | None = None
    robot_radius_m: float = 0.2
    caption: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Map metres to picture pixels: x to the right, y up, a whole number of pixels a cell."""

    left_m: float
    top_m: float
    px_per_m: float

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """(..., 2) pixel (column, row), from the picture's top left corner."""
        points = np.asarray(points_m, dtype=np.float64)
        return np.stack(
            [
                (points[..., 0] - self.left_m) * self.px_per_m,
                (self.top_m - points[..., 1]) * self.px_per_m,
            ],
            axis=-1,
        )

    def metres(self, pixels: FloatArray) -> FloatArray:
        """Inverse of `pixels`."""
        pixels = np.asarray(pixels, dtype=np.float64)
        return np.stack(
            [
                self.left_m + pixels[..., 0] / self.px_per_m,
                self.top_m - pixels[..., 1] / self.px_per_m,
            ],
            axis=-1,
        )


def png_bytes(picture: MapPicture) -> bytes:
    """The picture as a PNG file."""
    buffer = io.BytesIO()
    draw_map(picture).save(buffer, format="PNG", optimize=False, compress_level=6)
    return buffer.getvalue()


def draw_map(picture: MapPicture) -> Image:
    """The picture as a Pillow image."""
    from PIL import Image as PilImage

    cells, frame = _cells_and_frame(picture)
    scale = round(frame.px_per_m * picture.grid.resolution_m)
    map_pixels = cells.repeat(scale, axis=0).repeat(scale, axis=1)
    height, width = map_pixels.shape[:2]
    image = PilImage.new("RGB", (width, height + _FOOTER_PX), _FOOTER)
    image.paste(PilImage.fromarray(map_pixels), (0, 0))

    overlay = PilImage.new("RGBA", (width * SMOOTH, height * SMOOTH), (*_WAY, 0))
    _draw_things(overlay, picture, frame)
    overlay = overlay.resize((width, height), PilImage.Resampling.BOX)
    image.paste(overlay, (0, 0), overlay)
    _draw_footer(image, picture, frame)
    return image


def _cells_and_frame(picture: MapPicture) -> tuple[NDArray[np.uint8], Frame]:
    """Colours (H, W, 3) of the known part, first row = top, and where it lies."""
    resolution_m = picture.grid.resolution_m
    known = TernaryMap.of(picture.grid).cropped(math.ceil(MARGIN_M / resolution_m))
    height, width = known.is_free.shape
    scale = min(SCALE_MAX, max(1, LONG_SIDE_PX // max(height, width)))
    spare = max(0, -(-WIDTH_MIN_PX // scale) - width)
    left, right = spare // 2, spare - spare // 2
    pad = ((0, 0), (left, right))
    is_free, is_occupied = np.pad(known.is_free, pad), np.pad(known.is_occupied, pad)
    cells = np.empty((*is_free.shape, 3), dtype=np.uint8)
    cells[:] = _UNKNOWN
    cells[is_free] = _FREE
    cells[is_occupied] = _OCCUPIED
    frame = Frame(
        left_m=known.origin_m[0] - left * resolution_m,
        top_m=known.origin_m[1] + height * resolution_m,
        px_per_m=scale / resolution_m,
    )
    return cells[::-1], frame


def _draw_things(overlay: Image, picture: MapPicture, frame: Frame) -> None:
    from PIL import ImageDraw

    draw = ImageDraw.Draw(overlay)

    def at(points_m: FloatArray) -> list[tuple[float, float]]:
        pixels = frame.pixels(points_m) * SMOOTH
        return [(float(x), float(y)) for x, y in pixels.reshape(-1, 2)]

    def disc(
        x: float, y: float, radius: float, fill: tuple[int, int, int], edge: float
    ) -> None:
        white = radius + edge
        draw.ellipse((x - white, y - white, x + white, y + white), fill=(255, 255, 255))
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill)

    nodes = at(picture.nodes_m)
    for a, b in picture.links:
        draw.line([nodes[a], nodes[b]], fill=_LINK, width=SMOOTH)
    for gap in sorted(picture.gaps, key=lambda gap: gap.is_open):
        colour = _OPEN_GAP if gap.is_open else _CLOSED_GAP
        draw.line(at(gap.ends_m), fill=colour, width=(3 if gap.is_open else 1) * SMOOTH)
        x, y = at(gap.ends_m.mean(axis=0))[0]
        size = (5.5 if gap.is_open else 2.5) * SMOOTH
        draw.polygon([(x - size, y), (x, y - size), (x + size, y), (x, y + size)], fill=colour)
    way = at(_thinned(picture.way_m, 1.0 / frame.px_per_m))
    if len(way) > 1:
        draw.line(way, fill=_WAY, width=2 * SMOOTH, joint="curve")
    is_crowded = len(nodes) > 150  # noqa: PLR2004 - then smaller marks read better
    for x, y in nodes:
        disc(x, y, (2.0 if is_crowded else 3.5) * SMOOTH, _NODE, 0.0 if is_crowded else SMOOTH)
    if len(way):
        disc(*way[0], 5.0 * SMOOTH, _START, 1.5 * SMOOTH)
    if picture.robot is not None:
        _draw_robot(draw, picture.robot, picture.robot_radius_m, frame)


def _draw_robot(draw: object, robot: Pose2, radius_m: float, frame: Frame) -> None:
    from PIL import ImageDraw

    assert isinstance(draw, ImageDraw.ImageDraw)
    x, y = frame.pixels(np.array([robot.x_m, robot.y_m])) * SMOOTH
    radius = max(radius_m * frame.px_per_m, 7.0) * SMOOTH
    draw.ellipse(
        (x - radius, y - radius, x + radius, y + radius),
        fill=(*_ROBOT, 70),
        outline=_ROBOT,
        width=2 * SMOOTH,
    )
    tip = (
        x + 1.6 * radius * math.cos(robot.heading_rad),
        y - 1.6 * radius * math.sin(robot.heading_rad),
    )
    draw.line([(x, y), tip], fill=_ROBOT, width=3 * SMOOTH)


def _thinned(way_m: FloatArray, step_m: float) -> FloatArray:
    """Without the points nearer than `step_m` to their predecessor's place on a lattice."""
    if len(way_m) < 2:  # noqa: PLR2004
        return way_m
    lattice = np.floor(way_m / step_m)
    moved = np.any(lattice[1:] != lattice[:-1], axis=1)
    thinned: FloatArray = way_m[np.concatenate([[True], moved])]
    return thinned


def _draw_footer(image: Image, picture: MapPicture, frame: Frame) -> None:
    from PIL import ImageDraw, ImageFont

    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(_TEXT_PX)
    width, top = image.width, image.height - _FOOTER_PX
    draw.line([(0, top), (width, top)], fill=_RULE)

    length_m = scale_bar_m(0.22 * width / frame.px_per_m)
    bar_px = length_m * frame.px_per_m
    x, y = width - 16 - bar_px, top + 20
    draw.line([(x, y), (x + bar_px, y)], fill=_INK, width=3)
    for end in (x, x + bar_px):
        draw.line([(end, y - 5), (end, y + 5)], fill=_INK, width=2)
    draw.text((x + bar_px / 2, y + 8), f"{length_m:g} m", fill=_INK, font=font, anchor="ma")

    room, cursor = x - 12, 16.0
    caption = picture.caption
    while len(caption) > 1 and cursor + draw.textlength(caption, font=font) > room:
        caption = caption[:-2].rstrip(" ;,") + "\N{HORIZONTAL ELLIPSIS}"
    draw.text((cursor, top + 10), caption, fill=_INK, font=font)
    for mark, colour, label in _legend(picture):
        end = cursor + 18 + draw.textlength(label, font=font)
        if end > room:
            break
        cy = top + 45
        if mark == "disc":
            draw.ellipse((cursor, cy - 5, cursor + 10, cy + 5), fill=colour)
        elif mark == "line":
            draw.line([(cursor - 1, cy), (cursor + 12, cy)], fill=colour, width=3)
        elif mark == "ring":
            draw.ellipse((cursor, cy - 5, cursor + 10, cy + 5), outline=colour, width=2)
        else:
            cx = cursor + 5
            draw.polygon([(cx - 6, cy), (cx, cy - 6), (cx + 6, cy), (cx, cy + 6)], fill=colour)
        draw.text((cursor + 17, cy), label, fill=_INK, font=font, anchor="lm")
        cursor = end + 16


def _legend(picture: MapPicture) -> list[tuple[str, tuple[int, int, int], str]]:
    """Only what is on the picture."""
    entries: list[tuple[str, tuple[int, int, int], str]] = []
    if len(picture.way_m):
        entries += [("disc", _START, "start"), ("line", _WAY, "way driven")]
    if picture.robot is not None:
        entries.append(("ring", _ROBOT, "robot"))
    if len(picture.nodes_m):
        entries.append(("disc", _NODE, "scan"))
    if any(gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _OPEN_GAP, "unexplored gap"))
    if any(not gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _CLOSED_GAP, "other gap"))
    return entries


def scale_bar_m(wanted_m: float) -> float:
    """The longest of 1, 2, 5 x 10^n metres that is not longer than `wanted_m`."""
    power = 10.0 ** math.floor(math.log10(wanted_m))
    return max(
        step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted_m * (1 + 1e-9)
    )
