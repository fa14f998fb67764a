# SPDX-License-Identifier: MIT
"""A polar plot shows each beam where it looked, and marks weak ones and silent ones."""

import io

import numpy as np
from PIL import Image

from ins_robot.config import LrfConfig
from ins_robot.mapping import palette
from ins_robot.mapping.polar_picture import RIM_PX, SIZE_PX, polar_png_bytes
from ins_robot.messages import LaserScan
from ins_robot.sensing.range_error import range_std_m
from ins_robot.sensing.scan_summary import polar_picture

CONFIG = LrfConfig()
WEAK, VALID, NONE = palette.ORANGE, palette.DEEP_BLUE, palette.RED


def revolution(weak: slice, silent: slice) -> LaserScan:
    bearings = np.radians(np.arange(-180.0, 180.0))
    ranges = np.full(360, 3.0)
    ranges[silent] = np.nan
    stds = range_std_m(ranges, CONFIG.range_std_floor_m, CONFIG.range_std_per_m3)
    stds[weak] *= CONFIG.weak_return_factor
    return LaserScan(
        stamp_s=0.0,
        bearings_rad=bearings,
        ranges_m=ranges,
        range_std_m=stds,
        beam_offsets_s=np.zeros(360),
        range_max_m=6.0,
        rpm=200.0,
    )


def test_weak_and_silent_beams_are_told_and_drawn_where_they_look() -> None:
    left, right = slice(265, 275), slice(85, 95)  # about +90 and -90 degrees
    turns = [revolution(left, right) for _ in range(3)] + [
        revolution(slice(0, 0), right) for _ in range(2)
    ]
    picture = polar_picture(turns, CONFIG)
    assert np.flatnonzero(picture.is_weak).tolist() == list(range(265, 275))
    assert "350 of 360 beams valid, 10 weak; nearest 3.00 m" in picture.caption
    with Image.open(io.BytesIO(polar_png_bytes(picture))) as image:
        rgb = image.convert("RGB")
    centre, radius = SIZE_PX // 2, SIZE_PX // 2 - RIM_PX
    assert rgb.getpixel((centre - radius, centre)) == WEAK
    assert rgb.getpixel((centre, centre - radius)) == VALID
    rim = [rgb.getpixel((centre + radius - k, centre)) for k in range(1, 9)]
    assert NONE in rim
    assert VALID not in rim


def test_a_scan_that_saw_nothing_is_drawn_too() -> None:
    blind = polar_picture([revolution(slice(0, 0), slice(0, 360))] * 5, CONFIG)
    assert "0 of 360 beams valid" in blind.caption
    assert polar_png_bytes(blind).startswith(b"\x89PNG")
