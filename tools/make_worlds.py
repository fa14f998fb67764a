#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draw the worlds that ship with the simulator; usage: make_worlds.py [DIRECTORY].

Everything is wall until a room is cut out of it; then furniture is put in. Metres, y up, 0.05 m
a cell, no randomness: the same files every time (a test compares them).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

RESOLUTION_M = 0.05
FREE, WALL = 254, 0
DIRECTORY = Path(__file__).resolve().parent.parent / "ins_robot" / "simulation" / "worlds"


class Plan:
    """A floor plan of a given size, solid at first."""

    def __init__(
        self, width_m: float, height_m: float, start: tuple[float, float, float]
    ) -> None:
        self.pixels = np.full((_cells(height_m), _cells(width_m)), WALL, dtype=np.uint8)
        self.start = start

    def room(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Cut out a rectangle."""
        self.pixels[_cells(y0) : _cells(y1), _cells(x0) : _cells(x1)] = FREE

    def box(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Fill a rectangle."""
        self.pixels[_cells(y0) : _cells(y1), _cells(x0) : _cells(x1)] = WALL

    def disc(self, x: float, y: float, radius: float) -> None:
        """Fill a disc."""
        rows, cols = np.indices(self.pixels.shape) + 0.5
        at = np.hypot(cols * RESOLUTION_M - x, rows * RESOLUTION_M - y)
        self.pixels[at <= radius] = WALL

    def legs(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Four thin legs of a table or chair, one cell each, at the corners of a rectangle."""
        for x in (x0, x1):
            for y in (y0, y1):
                self.pixels[_cells(y), _cells(x)] = WALL

    def corner(self, x: float, y: float, dx: float, dy: float) -> None:
        """Fill the triangle between a corner and the points `dx` and `dy` along its walls."""
        rows, cols = np.indices(self.pixels.shape) + 0.5
        along, up = (cols * RESOLUTION_M - x) / dx, (rows * RESOLUTION_M - y) / dy
        self.pixels[(along >= 0.0) & (up >= 0.0) & (along + up <= 1.0)] = WALL

    def slanted(self, x0: float, y0: float, x1: float, y1: float, thickness: float) -> None:
        """Fill a straight wall between two points."""
        rows, cols = np.indices(self.pixels.shape) + 0.5
        px, py = cols * RESOLUTION_M - x0, rows * RESOLUTION_M - y0
        dx, dy = x1 - x0, y1 - y0
        along = np.clip((px * dx + py * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        off = np.hypot(px - along * dx, py - along * dy)
        self.pixels[off <= thickness / 2.0] = WALL

    def pgm(self) -> bytes:
        """The image, first row at the top."""
        height, width = self.pixels.shape
        return b"P5\n%d %d\n255\n" % (width, height) + self.pixels[::-1].tobytes()

    def yaml(self, name: str) -> str:
        """The description beside it."""
        x, y, degrees = self.start
        return (
            f"image: {name}.pgm\n"
            "mode: trinary\n"
            f"resolution: {RESOLUTION_M}\n"
            "origin: [0.0, 0.0, 0.0]\n"
            "negate: 0\n"
            "occupied_thresh: 0.65\n"
            "free_thresh: 0.196\n"
            f"start: [{x}, {y}, {degrees}]\n"
        )


def _cells(metres: float) -> int:
    return round(metres / RESOLUTION_M)


def open_room() -> Plan:
    """One hall, wider than the LRF sees, with an alcove and a few columns."""
    plan = Plan(14.0, 9.6, (2.0, 2.0, 0.0))
    plan.room(0.2, 0.2, 13.8, 8.4)
    plan.room(9.0, 8.4, 12.0, 9.4)  # alcove
    plan.box(4.6, 4.0, 5.0, 4.4)
    plan.box(9.4, 2.6, 9.8, 3.0)
    plan.disc(9.0, 6.4, 0.3)
    plan.corner(0.2, 8.4, 1.8, -1.5)
    return plan


def rooms() -> Plan:
    """Six rooms around a hall, doors of 0.8 to 0.9 m."""
    plan = Plan(10.0, 8.0, (5.0, 4.0, 90.0))
    plan.room(0.2, 3.1, 9.8, 4.7)  # hall
    for x0, x1 in ((0.2, 3.2), (3.4, 6.6), (6.8, 9.8)):
        plan.room(x0, 0.2, x1, 2.9)
        plan.room(x0, 4.9, x1, 7.8)
    for x, width in ((1.4, 0.8), (4.7, 0.9), (8.2, 0.85)):
        plan.room(x, 2.9, x + width, 3.1)
    for x, width in ((2.2, 0.85), (3.8, 0.8), (7.2, 0.9)):
        plan.room(x, 4.7, x + width, 4.9)
    plan.room(6.6, 6.2, 6.8, 7.0)  # between two rooms: a second way round
    plan.box(0.2, 0.2, 1.0, 1.6)  # bed
    plan.box(5.6, 0.2, 6.6, 0.7)  # cupboard
    plan.box(9.2, 1.0, 9.8, 2.2)
    plan.box(0.2, 7.2, 1.8, 7.8)
    plan.disc(5.2, 6.6, 0.4)  # round table
    plan.box(9.3, 6.6, 9.8, 7.8)
    return plan


def corridor_loop() -> Plan:
    """A corridor round a block, with niches, a store and a dead end off it."""
    plan = Plan(12.0, 9.0, (1.0, 1.0, 0.0))
    plan.room(0.3, 0.3, 11.7, 8.7)
    plan.box(1.8, 1.7, 10.3, 7.4)  # the block: corridors of 1.3 to 1.5 m
    plan.room(4.0, 1.7, 6.2, 3.6)  # store in the block
    plan.box(4.0, 1.7, 6.2, 1.9)
    plan.room(4.3, 1.7, 5.2, 1.9)  # its door
    plan.room(8.9, 5.0, 10.3, 6.0)  # niche
    plan.room(2.9, 6.7, 3.8, 7.4)
    plan.room(1.8, 3.9, 2.3, 4.6)
    plan.box(7.2, 8.4, 8.2, 8.7)  # cupboards along the walls
    plan.box(11.3, 2.2, 11.7, 3.4)
    plan.box(0.3, 5.8, 0.6, 6.6)
    plan.box(7.4, 0.3, 7.9, 0.6)
    return plan


def clutter() -> Plan:
    """One small room full of furniture on thin legs."""
    plan = Plan(6.4, 5.4, (0.7, 0.7, 45.0))
    plan.room(0.2, 0.2, 6.2, 5.2)
    plan.legs(2.0, 1.6, 3.4, 2.4)  # table
    for x in (2.1, 2.9):
        plan.legs(x, 2.55, x + 0.4, 2.9)  # chairs
    plan.legs(4.3, 3.6, 5.3, 4.4)
    plan.legs(4.6, 3.0, 5.0, 3.4)
    plan.legs(0.8, 3.4, 1.2, 3.8)  # stool
    plan.box(5.5, 0.2, 6.2, 1.6)  # shelf
    plan.box(0.2, 4.7, 1.8, 5.2)  # sideboard
    plan.disc(4.6, 1.4, 0.2)  # bin
    plan.disc(2.6, 4.2, 0.15)
    plan.box(3.4, 4.8, 3.6, 5.2)
    plan.slanted(0.2, 2.2, 0.75, 2.5, 0.15)
    return plan


def office() -> Plan:
    """A corridor with eight furnished rooms."""
    plan = Plan(15.2, 10.2, (2.2, 5.2, 0.0))
    plan.room(0.2, 4.3, 15.0, 6.1)  # corridor
    walls = (0.1, 3.9, 7.6, 11.3, 15.1)
    for x0, x1 in pairwise(walls):
        left, right = max(0.2, x0 + 0.1), min(15.0, x1 - 0.1)
        plan.room(left, 0.2, right, 4.15)
        plan.room(left, 6.25, right, 10.0)
    for x in (2.6, 4.6, 10.0, 12.0):
        plan.room(x, 4.15, x + 0.9, 4.3)
    for x in (1.0, 6.2, 8.2, 13.6):
        plan.room(x, 6.1, x + 0.9, 6.25)
    plan.room(7.5, 7.4, 7.7, 8.25)  # between two offices
    for x, y in ((0.2, 1.6), (5.2, 0.2), (8.6, 1.4), (13.4, 0.6)):
        plan.box(x, y, x + 1.6, y + 0.75)  # desks against something
        plan.legs(x + 0.5, y + 0.95, x + 0.9, y + 1.35)  # and a chair
    for x, y in ((1.2, 8.8), (4.4, 8.9), (13.0, 8.7)):
        plan.legs(x, y, x + 1.4, y + 0.7)  # desks on legs
    plan.legs(8.6, 7.7, 10.4, 8.7)  # meeting table with its seats
    for x in (8.9, 9.7):
        plan.legs(x, 8.9, x + 0.4, 9.3)
    plan.box(3.4, 7.2, 3.8, 9.0)  # cupboards
    plan.box(10.6, 2.6, 11.2, 3.9)
    plan.box(14.5, 6.25, 15.0, 7.4)
    plan.box(6.4, 4.3, 7.4, 4.6)  # copier in the corridor
    plan.disc(14.5, 5.7, 0.2)  # plant
    return plan


def figure5() -> Plan:
    """Shaped like the paper's figure 5.

    The robot comes out of a small room (N1) to a crossing (N2). The narrow way up leads round a
    block and back to a place (N7) from which the crossing can be seen along the broad way below
    the block. N7 opens on a chain of rooms that ends dead (N13); the last unexplored gap is
    then the way down at the crossing: along the broad way, or back round the whole block.
    """
    plan = Plan(14.0, 10.2, (1.4, 3.6, 0.0))
    plan.room(0.4, 2.6, 2.4, 4.6)  # N1
    plan.room(2.4, 3.0, 3.0, 4.2)
    plan.room(3.0, 2.8, 10.2, 4.4)  # crossing and broad way
    plan.room(3.0, 4.4, 4.0, 9.8)  # narrow way up
    plan.room(3.0, 8.6, 10.2, 9.8)
    plan.room(9.0, 4.4, 10.2, 8.6)
    plan.room(10.2, 3.1, 10.4, 4.0)  # door of the chain
    plan.room(10.4, 2.6, 13.6, 4.6)
    plan.room(11.8, 4.6, 12.7, 4.8)
    plan.room(10.6, 4.8, 13.6, 6.8)
    plan.room(11.0, 6.8, 11.9, 7.0)
    plan.room(10.6, 7.0, 13.6, 9.8)
    plan.room(3.0, 2.6, 4.8, 2.8)  # way down at the crossing
    plan.room(2.6, 0.4, 6.0, 2.6)
    plan.box(13.2, 8.8, 13.6, 9.8)  # so that no two rooms look alike
    plan.box(10.4, 2.6, 10.9, 2.9)
    plan.box(5.4, 0.4, 6.0, 1.0)
    return plan


WORLDS: dict[str, Callable[[], Plan]] = {
    draw.__name__: draw for draw in (open_room, rooms, corridor_loop, clutter, office, figure5)
}


def write(directory: Path) -> None:
    """Write all worlds."""
    directory.mkdir(parents=True, exist_ok=True)
    for name, draw in WORLDS.items():
        plan = draw()
        (directory / f"{name}.pgm").write_bytes(plan.pgm())
        (directory / f"{name}.yaml").write_text(plan.yaml(name), encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else DIRECTORY)
