# SPDX-License-Identifier: MIT
"""A scan as a polar plot: what the LRF sees around it, x (ahead) up, y to the left.

In go ranges by bearing, out come PNG bytes. Rings carry metres, spokes degrees; weak beams are
orange, beams without a reading are ticks on the rim. Pillow is imported when used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping import palette
from ins_robot.mapping.occupancy_grid import BoolArray
from ins_robot.mapping.palette import FOOTER_PX, INK, PALE_RULE, SMOOTH, TEXT_PX, WHITE, Colour
from ins_robot.mapping.png_file import png_file
from ins_robot.mapping.round_lengths import round_above

if TYPE_CHECKING:
    from PIL.Image import Image

SIZE_PX = 900
RIM_PX = 58  # from the outer ring to the edge: bearings are written there
RINGS_MAX = 6
SPOKE_DEG = 30

_BEAM = palette.PALE_BLUE
_VALID = palette.DEEP_BLUE
_WEAK = palette.ORANGE
_NONE = palette.RED
_HERE = palette.GREEN


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarPicture:
    """What is plotted; one entry per beam, (B,), ranges NaN where there is no reading."""

    bearings_rad: FloatArray
    ranges_m: FloatArray
    is_weak: BoolArray
    range_max_m: float
    caption: str = ""


def polar_png_bytes(picture: PolarPicture) -> bytes:
    """The plot as a PNG file."""
    return png_file(draw_polar(picture))


def draw_polar(picture: PolarPicture) -> Image:
    """The plot as a Pillow image."""
    from PIL import Image as PilImage

    size = SIZE_PX * SMOOTH
    plot = PilImage.new("RGB", (size, size), WHITE)
    _Plot(plot, picture).draw()
    image = PilImage.new("RGB", (SIZE_PX, SIZE_PX + FOOTER_PX), WHITE)
    image.paste(plot.resize((SIZE_PX, SIZE_PX), PilImage.Resampling.BOX), (0, 0))
    _draw_footer(image, picture)
    return image


class _Plot:
    """The plot at `SMOOTH` times its size."""

    def __init__(self, image: Image, picture: PolarPicture) -> None:
        from PIL import ImageDraw, ImageFont

        valid_m = picture.ranges_m[np.isfinite(picture.ranges_m)]
        farthest_m = float(valid_m.max()) if len(valid_m) else picture.range_max_m
        self._step_m = round_above(farthest_m / RINGS_MAX)
        self._outer_m = self._step_m * math.ceil(farthest_m / self._step_m - 1e-9)
        self._draw = ImageDraw.Draw(image)
        self._font = ImageFont.load_default(TEXT_PX * SMOOTH)
        self._centre = image.width / 2.0
        self._radius = self._centre - RIM_PX * SMOOTH
        self._picture = picture

    def draw(self) -> None:
        """Everything, readings last."""
        picture = self._picture
        is_valid = np.isfinite(picture.ranges_m)
        beams = picture.bearings_rad[is_valid], picture.ranges_m[is_valid]
        for bearing, range_m in zip(*beams, strict=True):
            self._line(float(bearing), 0.0, float(range_m), _BEAM, 2)
        self._grid()
        for bearing in picture.bearings_rad[~is_valid]:
            self._line(float(bearing), 0.975 * self._outer_m, self._outer_m, _NONE, 2)
        for (bearing, range_m), weak in zip(
            zip(*beams, strict=True), picture.is_weak[is_valid], strict=True
        ):
            at = self._at(float(bearing), float(range_m))
            self._draw.circle(at, 3.2 * SMOOTH, fill=_WEAK if weak else _VALID)
        self._draw.circle((self._centre, self._centre), 5.0 * SMOOTH, fill=_HERE)

    def _grid(self) -> None:
        for ring in range(1, round(self._outer_m / self._step_m) + 1):
            range_m = ring * self._step_m
            radius = self._radius * range_m / self._outer_m
            self._draw.circle(
                (self._centre, self._centre), radius, outline=PALE_RULE, width=SMOOTH
            )
            label = f"{range_m:g} m"
            self._text(self._at(math.radians(-75.0), range_m), label)
        for degrees in range(-180 + SPOKE_DEG, 181, SPOKE_DEG):
            bearing = math.radians(degrees)
            self._line(bearing, 0.0, self._outer_m, PALE_RULE, 1)
            rim_m = self._outer_m * (1.0 + 0.5 * RIM_PX * SMOOTH / self._radius)
            self._text(self._at(bearing, rim_m), f"{degrees}\N{DEGREE SIGN}")

    def _at(self, bearing_rad: float, range_m: float) -> tuple[float, float]:
        """Pixels; the base's x axis points up."""
        length = self._radius * range_m / self._outer_m
        return (
            self._centre - length * math.sin(bearing_rad),
            self._centre - length * math.cos(bearing_rad),
        )

    def _line(
        self, bearing: float, from_m: float, to_m: float, colour: Colour, px: int
    ) -> None:
        ends = [self._at(bearing, from_m), self._at(bearing, to_m)]
        self._draw.line(ends, fill=colour, width=px * SMOOTH)

    def _text(self, at: tuple[float, float], text: str) -> None:
        self._draw.text(
            at,
            text,
            fill=INK,
            font=self._font,
            anchor="mm",
            stroke_width=2 * SMOOTH,
            stroke_fill=WHITE,
        )


def _draw_footer(image: Image, picture: PolarPicture) -> None:
    """Caption and legend, below the plot."""
    from PIL import ImageDraw, ImageFont

    draw, font = ImageDraw.Draw(image), ImageFont.load_default(TEXT_PX)
    draw.line([(0, SIZE_PX), (image.width, SIZE_PX)], fill=PALE_RULE)
    draw.text((16, SIZE_PX + 10), picture.caption, fill=INK, font=font)
    x, y = 16.0, SIZE_PX + 45
    for colour, label in (
        (_HERE, "LRF, ahead is up"),
        (_VALID, "reading"),
        (_WEAK, "weak reading"),
        (_NONE, "no reading (on the rim)"),
    ):
        draw.circle((x + 5, y), 5, fill=colour)
        draw.text((x + 17, y), label, fill=INK, font=font, anchor="lm")
        x += 33 + draw.textlength(label, font=font)
