# SPDX-License-Identifier: MIT
"""Colours and sizes that all pictures share; what a colour stands for, each picture says."""

from __future__ import annotations

Colour = tuple[int, int, int]  # red, green, blue, 0 to 255

WHITE = (255, 255, 255)
MIST = (226, 229, 234)
RULE, PALE_RULE = (208, 213, 220), (214, 219, 226)
GREY = (148, 158, 172)
INK = (51, 61, 77)
NIGHT = (24, 32, 44)
PALE_BLUE, BLUE, DEEP_BLUE = (220, 232, 247), (46, 124, 214), (17, 75, 145)
GREEN = (22, 150, 96)
ORANGE = (240, 130, 20)
RED, DEEP_RED = (214, 40, 57), (190, 30, 30)
PURPLE = (150, 40, 190)

SMOOTH = 2  # lines and marks are drawn this many times larger and scaled down
TEXT_PX = 15
FOOTER_PX = 64  # height of the caption and legend below a picture
