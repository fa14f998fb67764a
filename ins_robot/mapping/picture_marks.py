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
from ins_robot.mapping import palette
from ins_robot.mapping.map_picture import Frame, GoalMark, MapPicture
from ins_robot.mapping.palette import FOOTER_PX, INK, RULE, SMOOTH, TEXT_PX, WHITE, Colour
from ins_robot.mapping.round_lengths import round_below
from ins_robot.mapping.zones import ZoneKind

if TYPE_CHECKING:
    from PIL.Image import Image

Point = tuple[float, float]

BAND_PX = 256
CROWDED_NODES = 150  # with more, smaller marks read better

_WAY = palette.BLUE
_NODE = palette.DEEP_BLUE
_START = palette.GREEN
_OPEN_GAP = palette.ORANGE
_OTHER_GAP = palette.GREY
_ROBOT = palette.RED
_ZONE = palette.DEEP_RED
_GOAL = palette.PURPLE
DASH_M = 0.12

_EDGE = 16  # in units, as are TEXT_PX and FOOTER_PX here: see `unit_px`


def unit_px(width: int) -> float:
    """To what marks and texts are sized: 1 pixel up to a width of 1000, then growing along."""
    return max(1.0, width / 1000.0)


def footer_px(width: int) -> int:
    """Height of the footer below a map of this width."""
    return round(FOOTER_PX * unit_px(width))


def draw_marks(image: Image, size: tuple[int, int], picture: MapPicture, frame: Frame) -> None:
    """Draw all marks on the map, the upper `size` (width, height) of the image."""
    unit = unit_px(size[0])
    width, height = size
    for top in range(0, height, BAND_PX):
        rows = min(BAND_PX, height - top)
        band = PilImage.new("RGBA", (width * SMOOTH, rows * SMOOTH), (*_WAY, 0))
        _Band(band, top, frame, unit * SMOOTH).draw(picture)
        band = band.resize((width, rows), PilImage.Resampling.BOX)
        image.paste(band, (0, top), band)


class _Band:
    """One horizontal stripe of the picture, to be drawn at `SMOOTH` times its size."""

    def __init__(self, image: Image, top: int, frame: Frame, unit: float) -> None:
        self._draw = ImageDraw.Draw(image)
        self._unit = unit
        self._top = top
        self._frame = frame

    def draw(self, picture: MapPicture) -> None:
        """All marks, the important ones last."""
        for outline_m in picture.limits_m:
            self._dashed(outline_m, _ZONE, 2)
        for zone in picture.zones:
            self._zone(self._at(np.array(zone.points_m)), zone.kind)
        nodes = self._at(picture.nodes_m)
        for gap in sorted(picture.gaps, key=lambda gap: gap.is_open):
            self._gap(gap.ends_m, is_open=gap.is_open)
        way = self._at(_thinned(picture.way_m, 1.0 / self._frame.px_per_m))
        self._line(way, _WAY, 2)
        is_crowded = len(nodes) > CROWDED_NODES
        for node in nodes:
            self._disc(node, _NODE, 2.0 if is_crowded else 3.5, 0.0 if is_crowded else 1.0)
        if picture.goal is not None:
            self._goal(picture.goal)
        for node, number in zip(nodes, picture.node_ids, strict=False):
            self._number(node, number)
        if picture.robot is not None:
            self._robot(picture.robot, picture.robot_radius_m)
        if way:
            self._disc(way[0], _START, 5.0, 1.5)  # also where the robot has come home to it

    def _at(self, points_m: FloatArray) -> list[Point]:
        pixels = self._frame.pixels(points_m).reshape(-1, 2)
        return [(float(x) * SMOOTH, (float(y) - self._top) * SMOOTH) for x, y in pixels]

    def _line(self, points: Sequence[Point], colour: Colour, width: int) -> None:
        if len(points) > 1:
            pixels = round(width * self._unit)
            self._draw.line(list(points), fill=colour, width=pixels, joint="curve")

    def _dashed(self, path_m: FloatArray, colour: Colour, width: int) -> None:
        for start, end in dashes(path_m, DASH_M):
            self._line(self._at(np.array([start, end])), colour, width)

    def _disc(self, at: Point, colour: Colour, radius: float, edge: float) -> None:
        if edge:
            self._draw.circle(at, (radius + edge) * self._unit, fill=WHITE)
        self._draw.circle(at, radius * self._unit, fill=colour)

    def _zone(self, points: list[Point], kind: ZoneKind) -> None:
        if kind is ZoneKind.NO_GO:
            self._draw.polygon(points, fill=(*_ZONE, 60))
            points = [*points, points[0]]
        self._line(points, _ZONE, 3)

    def _gap(self, ends_m: FloatArray, *, is_open: bool) -> None:
        middle = self._at(ends_m.mean(axis=0))[0]
        if is_open:
            self._line(self._at(ends_m), _OPEN_GAP, 3)
            self._draw.polygon(_diamond(middle, 6.0 * self._unit), fill=_OPEN_GAP)
        else:
            self._draw.polygon(_diamond(middle, 3.0 * self._unit), fill=_OTHER_GAP)

    def _goal(self, goal: GoalMark) -> None:
        self._dashed(goal.path_m, _GOAL, 3)
        x, y = self._at(np.array([goal.place.x_m, goal.place.y_m]))[0]
        radius, edge = 9.0 * self._unit, round(3 * self._unit)
        self._draw.circle((x, y), radius, outline=_GOAL, width=edge)
        c, s = math.cos(goal.place.heading_rad), math.sin(goal.place.heading_rad)
        self._line([(x, y), (x + 2.2 * radius * c, y - 2.2 * radius * s)], _GOAL, 3)

    def _number(self, node: Point, number: int) -> None:
        self._draw.text(
            (node[0] + 6 * self._unit, node[1] - 6 * self._unit),
            str(number),
            fill=_NODE,
            font=ImageFont.load_default(13 * self._unit),
            anchor="ls",
            stroke_width=round(self._unit),
            stroke_fill=WHITE,
        )

    def _robot(self, robot: Pose2, radius_m: float) -> None:
        x, y = self._at(np.array([robot.x_m, robot.y_m]))[0]
        radius = max(radius_m * self._frame.px_per_m * SMOOTH, 7.0 * self._unit)
        self._draw.circle(
            (x, y), radius, fill=(*_ROBOT, 70), outline=_ROBOT, width=round(2 * self._unit)
        )
        c, s = math.cos(robot.heading_rad), math.sin(robot.heading_rad)
        self._line([(x, y), (x + 1.6 * radius * c, y - 1.6 * radius * s)], _ROBOT, 3)


def _diamond(at: Point, size: float) -> list[Point]:
    x, y = at
    return [(x - size, y), (x, y - size), (x + size, y), (x, y + size)]


def dashes(path_m: FloatArray, dash_m: float) -> list[tuple[FloatArray, FloatArray]]:
    """Ends of the dashes of a dashed line along (N, 2), gaps as long as dashes."""
    steps = np.hypot(*np.diff(path_m, axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    starts = np.arange(0.0, way[-1], 2.0 * dash_m)
    ends = np.minimum(starts + dash_m, way[-1])

    def at(distances: FloatArray) -> FloatArray:
        return np.stack([np.interp(distances, way, path_m[:, k]) for k in (0, 1)], axis=-1)

    return list(zip(at(starts), at(ends), strict=True))


def _thinned(way_m: FloatArray, step_m: float) -> FloatArray:
    """Without the points that lie in the same cell of `step_m` as the one before."""
    lattice = np.floor(way_m / step_m)
    is_kept = np.ones(len(way_m), dtype=bool)
    is_kept[1:] = np.any(lattice[1:] != lattice[:-1], axis=1)
    return np.asarray(way_m[is_kept], dtype=np.float64)


def draw_footer(image: Image, size: tuple[int, int], picture: MapPicture, frame: Frame) -> None:
    """Caption, legend and scale bar, below the map of `size` (width, height)."""
    unit = unit_px(size[0])
    top = size[1]
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(TEXT_PX * unit)
    draw.line([(0, top), (image.width, top)], fill=RULE, width=round(unit))
    room = _draw_scale_bar(draw, size, frame, unit) - 12 * unit

    caption = picture.caption
    while len(caption) > 1 and _EDGE * unit + draw.textlength(caption, font=font) > room:
        caption = caption[:-2].rstrip(" ;,") + "\N{HORIZONTAL ELLIPSIS}"
    draw.text((_EDGE * unit, top + 10 * unit), caption, fill=INK, font=font)

    x, y = _EDGE * unit, top + (FOOTER_PX - 19) * unit
    for shape, colour, label in legend(picture):
        end = x + 18 * unit + draw.textlength(label, font=font)
        if end > room:
            break
        centre = (x + 5 * unit, y)
        if shape == "line":
            draw.line([(x - unit, y), (x + 11 * unit, y)], fill=colour, width=round(3 * unit))
        elif shape == "dashes":
            for left in (x - unit, x + 7 * unit):
                draw.line([(left, y), (left + 4 * unit, y)], fill=colour, width=round(2 * unit))
        elif shape == "ring":
            draw.circle(centre, 5 * unit, outline=colour, width=round(2 * unit))
        elif shape == "square":
            draw.rectangle([(x, y - 5 * unit), (x + 10 * unit, y + 5 * unit)], fill=colour)
        elif shape == "disc":
            draw.circle(centre, 5 * unit, fill=colour)
        else:
            draw.polygon(_diamond(centre, 6 * unit), fill=colour)
        draw.text((x + 17 * unit, y), label, fill=INK, font=font, anchor="lm")
        x = end + 16 * unit


def _draw_scale_bar(
    draw: ImageDraw.ImageDraw, size: tuple[int, int], frame: Frame, unit: float
) -> float:
    """Draw it at the right; the column where it begins."""
    length_m = round_below(0.22 * size[0] / frame.px_per_m)
    length = length_m * frame.px_per_m
    x, y, tick = size[0] - _EDGE * unit - length, size[1] + 20 * unit, 5 * unit
    draw.line([(x, y), (x + length, y)], fill=INK, width=round(3 * unit))
    for end in (x, x + length):
        draw.line([(end, y - tick), (end, y + tick)], fill=INK, width=round(2 * unit))
    middle = (x + length / 2, y + 8 * unit)
    font = ImageFont.load_default(TEXT_PX * unit)
    draw.text(middle, f"{length_m:g} m", fill=INK, font=font, anchor="ma")
    return x


def legend(picture: MapPicture) -> list[tuple[str, Colour, str]]:
    """Shape, colour and name of what is on the picture."""
    entries: list[tuple[str, Colour, str]] = []
    if len(picture.way_m):
        entries += [("disc", _START, "start"), ("line", _WAY, "way driven")]
    if picture.robot is not None:
        entries.append(("ring", _ROBOT, "robot"))
    if picture.goal is not None:
        entries.append(("ring", _GOAL, "next"))
    kinds = {zone.kind for zone in picture.zones}
    if ZoneKind.NO_GO in kinds:
        entries.append(("square", _ZONE, "no-go zone"))
    if kinds - {ZoneKind.NO_GO}:
        entries.append(("line", _ZONE, "virtual wall"))
    if picture.limits_m:
        entries.append(("dashes", _ZONE, "limit"))
    if len(picture.nodes_m):
        entries.append(("disc", _NODE, "scan"))
    if any(gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _OPEN_GAP, "unexplored gap"))
    if any(not gap.is_open for gap in picture.gaps):
        entries.append(("diamond", _OTHER_GAP, "closed gap"))
    return entries
