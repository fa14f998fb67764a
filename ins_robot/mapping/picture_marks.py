# SPDX-License-Identifier: MIT
"""What is drawn on the picture of a map, and the footer below it.

Marks are drawn at twice the size and scaled down, so lines are smooth; band by band, so that a
large picture needs little memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_picture import FOOTER_PX, Frame, MapPicture

if TYPE_CHECKING:
    from PIL.Image import Image

Colour = tuple[int, int, int]
Point = tuple[float, float]

SMOOTH = 2
BAND_PX = 256
CROWDED_NODES = 150  # with more, smaller marks read better

_INK = (51, 61, 77)
_RULE = (208, 213, 220)
_WHITE = (255, 255, 255)
_WAY = (46, 124, 214)
_LINK = (150, 190, 232)
_NODE = (17, 75, 145)
_START = (22, 150, 96)
_OPEN_GAP = (240, 130, 20)
_OTHER_GAP = (148, 158, 172)
_ROBOT = (214, 40, 57)

_TEXT_PX = 15
_EDGE_PX = 16


def draw_marks(image: Image, height: int, picture: MapPicture, frame: Frame) -> None:
    """Draw all marks on the upper `height` rows of the image."""
    for top in range(0, height, BAND_PX):
        size = (image.width, min(BAND_PX, height - top))
        band = PilImage.new("RGBA", (size[0] * SMOOTH, size[1] * SMOOTH), (*_WAY, 0))
        _Band(band, top, frame).draw(picture)
        band = band.resize(size, PilImage.Resampling.BOX)
        image.paste(band, (0, top), band)


class _Band:
    """One horizontal stripe of the picture, to be drawn at `SMOOTH` times its size."""

    def __init__(self, image: Image, top: int, frame: Frame) -> None:
        self._draw = ImageDraw.Draw(image)
        self._top = top
        self._frame = frame

    def draw(self, picture: MapPicture) -> None:
        """All marks, the important ones last."""
        nodes = self._at(picture.nodes_m)
        for a, b in picture.links:
            self._line([nodes[a], nodes[b]], _LINK, 1)
        for gap in sorted(picture.gaps, key=lambda gap: gap.is_open):
            self._gap(gap.ends_m, is_open=gap.is_open)
        way = self._at(_thinned(picture.way_m, 1.0 / self._frame.px_per_m))
        self._line(way, _WAY, 2)
        is_crowded = len(nodes) > CROWDED_NODES
        for node in nodes:
            self._disc(node, _NODE, 2.0 if is_crowded else 3.5, 0.0 if is_crowded else 1.0)
        if way:
            self._disc(way[0], _START, 5.0, 1.5)
        if picture.robot is not None:
            self._robot(picture.robot, picture.robot_radius_m)

    def _at(self, points_m: FloatArray) -> list[Point]:
        pixels = self._frame.pixels(points_m).reshape(-1, 2)
        return [(float(x) * SMOOTH, (float(y) - self._top) * SMOOTH) for x, y in pixels]

    def _line(self, points: Sequence[Point], colour: Colour, width_px: int) -> None:
        if len(points) > 1:
            self._draw.line(list(points), fill=colour, width=width_px * SMOOTH, joint="curve")

    def _disc(self, at: Point, colour: Colour, radius_px: float, edge_px: float) -> None:
        if edge_px:
            self._draw.circle(at, (radius_px + edge_px) * SMOOTH, fill=_WHITE)
        self._draw.circle(at, radius_px * SMOOTH, fill=colour)

    def _gap(self, ends_m: FloatArray, *, is_open: bool) -> None:
        colour = _OPEN_GAP if is_open else _OTHER_GAP
        self._line(self._at(ends_m), colour, 3 if is_open else 1)
        middle = self._at(ends_m.mean(axis=0))[0]
        self._draw.polygon(_diamond(middle, (5.5 if is_open else 2.5) * SMOOTH), fill=colour)

    def _robot(self, robot: Pose2, radius_m: float) -> None:
        x, y = self._at(np.array([robot.x_m, robot.y_m]))[0]
        radius = max(radius_m * self._frame.px_per_m, 7.0) * SMOOTH
        self._draw.circle((x, y), radius, fill=(*_ROBOT, 70), outline=_ROBOT, width=2 * SMOOTH)
        c, s = math.cos(robot.heading_rad), math.sin(robot.heading_rad)
        self._line([(x, y), (x + 1.6 * radius * c, y - 1.6 * radius * s)], _ROBOT, 3)


def _diamond(at: Point, size: float) -> list[Point]:
    x, y = at
    return [(x - size, y), (x, y - size), (x + size, y), (x, y + size)]


def _thinned(way_m: FloatArray, step_m: float) -> FloatArray:
    """Without the points that lie in the same cell of `step_m` as the one before."""
    lattice = np.floor(way_m / step_m)
    is_kept = np.ones(len(way_m), dtype=bool)
    is_kept[1:] = np.any(lattice[1:] != lattice[:-1], axis=1)
    return np.asarray(way_m[is_kept], dtype=np.float64)


def draw_footer(image: Image, top: int, picture: MapPicture, frame: Frame) -> None:
    """Caption, legend and scale bar, below row `top`."""
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(_TEXT_PX)
    draw.line([(0, top), (image.width, top)], fill=_RULE)
    room = _draw_scale_bar(draw, top, image.width, frame) - 12

    caption = picture.caption
    while len(caption) > 1 and _EDGE_PX + draw.textlength(caption, font=font) > room:
        caption = caption[:-2].rstrip(" ;,") + "\N{HORIZONTAL ELLIPSIS}"
    draw.text((_EDGE_PX, top + 10), caption, fill=_INK, font=font)

    x, y = float(_EDGE_PX), float(top + FOOTER_PX - 19)
    for shape, colour, label in _legend(picture):
        end = x + 18 + draw.textlength(label, font=font)
        if end > room:
            break
        if shape == "line":
            draw.line([(x - 1, y), (x + 11, y)], fill=colour, width=3)
        elif shape == "ring":
            draw.circle((x + 5, y), 5, outline=colour, width=2)
        elif shape == "disc":
            draw.circle((x + 5, y), 5, fill=colour)
        else:
            draw.polygon(_diamond((x + 5, y), 6), fill=colour)
        draw.text((x + 17, y), label, fill=_INK, font=font, anchor="lm")
        x = end + 16


def _draw_scale_bar(draw: ImageDraw.ImageDraw, top: int, width: int, frame: Frame) -> float:
    """Draw it at the right; the column where it begins."""
    length_m = scale_bar_m(0.22 * width / frame.px_per_m)
    length_px = length_m * frame.px_per_m
    x, y = width - _EDGE_PX - length_px, top + 20
    draw.line([(x, y), (x + length_px, y)], fill=_INK, width=3)
    for end in (x, x + length_px):
        draw.line([(end, y - 5), (end, y + 5)], fill=_INK, width=2)
    font = ImageFont.load_default(_TEXT_PX)
    draw.text((x + length_px / 2, y + 8), f"{length_m:g} m", fill=_INK, font=font, anchor="ma")
    return x


def _legend(picture: MapPicture) -> list[tuple[str, Colour, str]]:
    """Shape, colour and name of what is on the picture."""
    entries: list[tuple[str, Colour, str]] = []
    if len(picture.way_m):
        entries += [("disc", _START, "start"), ("line", _WAY, "way driven")]
    if picture.robot is not None:
        entries.append(("ring", _ROBOT, "robot"))
    if len(picture.nodes_m):
        entries.append(("disc", _NODE, "scan"))
    if any(gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _OPEN_GAP, "unexplored gap"))
    if any(not gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _OTHER_GAP, "other gap"))
    return entries


def scale_bar_m(wanted_m: float) -> float:
    """The longest of 1, 2, 5 x 10^n metres that is not longer than `wanted_m`."""
    power = 10.0 ** math.floor(math.log10(wanted_m))
    return max(
        step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted_m * (1 + 1e-9)
    )
