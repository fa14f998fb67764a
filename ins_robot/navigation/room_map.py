# SPDX-License-Identifier: MIT
"""How far a grid's cells are from the lines that the body keeps off: lines and a grid in.

Grids grow by strips and zones are small: only what is new and near a line is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.limit_lines import LimitLine, Side

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Window:
    """A rectangle of the lattice: (row, col) of its first cell and past its last."""

    low: IntArray
    high: IntArray

    @property
    def shape(self) -> tuple[int, int]:
        height, width = (self.high - self.low).tolist()
        return height, width

    def shared_with(self, other: _Window) -> _Window:
        low = np.clip(other.low, self.low, self.high)
        return _Window(low, np.clip(other.high, low, self.high))

    def within(self, outer: _Window) -> tuple[slice, slice]:
        """Its place in the array of another."""
        low, high = (self.low - outer.low).tolist(), (self.high - outer.low).tolist()
        return slice(low[0], high[0]), slice(low[1], high[1])

    def around(self, inner: _Window) -> list[_Window]:
        """All of it but the inner one, in strips."""
        (top, left), (bottom, right) = self.low.tolist(), self.high.tolist()
        (first, begin), (last, end) = inner.low.tolist(), inner.high.tolist()
        strips = [
            (top, left, first, right),
            (last, left, bottom, right),
            (first, left, last, begin),
            (first, end, last, right),
        ]
        return [_Window(np.array(strip[:2]), np.array(strip[2:])) for strip in strips]


class RoomMap:
    """Distances from the nearest of some lines, kept while the grid stays or grows."""

    def __init__(self, lines: Sequence[LimitLine], near_m: float) -> None:
        self._lines, self._near_m = lines, near_m
        self._window = _Window(np.zeros(2, np.int64), np.zeros(2, np.int64))
        self._room_m: FloatArray = np.zeros((0, 0))

    def on(self, grid: OccupancyGrid) -> FloatArray:
        """(H, W) metres, negative where the body may not be.

        A zone or wall further away than `near_m` does not count: inf where there is no other.
        """
        corner = -grid.cells(np.zeros(2))
        window = _Window(corner, corner + grid.shape)
        known = window.shared_with(self._window)
        if known.shape != window.shape or known.shape != self._window.shape:
            room = np.full(window.shape, np.inf)
            room[known.within(window)] = self._room_m[known.within(self._window)]
            for strip in window.around(known):
                self._measure(grid, window, strip, room)
            self._window, self._room_m = window, room
        return self._room_m

    def _measure(
        self, grid: OccupancyGrid, window: _Window, strip: _Window, room: FloatArray
    ) -> None:
        for line in self._lines:
            part = strip
            if line.allowed is not Side.INSIDE:  # the outside of a boundary is everywhere
                low = grid.cells(line.points_m.min(axis=0) - self._near_m)
                high = grid.cells(line.points_m.max(axis=0) + self._near_m) + 1
                part = strip.shared_with(_Window(window.low + low, window.low + high))
            cells = np.argwhere(np.ones(part.shape, bool)) + (part.low - window.low)
            here = room[part.within(window)]
            near = line.room_m(grid.metres(cells)).reshape(here.shape)
            np.minimum(here, near, out=here)
