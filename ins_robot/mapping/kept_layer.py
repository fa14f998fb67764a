# SPDX-License-Identifier: MIT
"""Layers over a growing grid that are worked out again only around what has changed.

For values that depend on what lies within a certain distance only, such as distances up to it:
a change reaches so far and no farther, and so much around it must be looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from ins_robot.geometry.angles import FloatArray

Box = tuple[int, int, int, int]  # first row, first col, past the last row, past the last col


class Lattice(Protocol):
    """A grid whose cell (0, 0) has a place on an endless lattice."""

    resolution_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""

    @property
    def corner(self) -> tuple[int, int]:
        """Lattice (row, col) of cell (0, 0)."""


class Changes:
    """Where a grid changed, in order, on the lattice."""

    def __init__(self) -> None:
        self._boxes: list[Box] = []

    def __len__(self) -> int:
        return len(self._boxes)

    def add(self, corner: tuple[int, int], size: tuple[int, int]) -> None:
        """Something changed in a window."""
        self._boxes.append((*corner, corner[0] + size[0], corner[1] + size[1]))

    def since(self, number: int) -> Box | None:
        """A box around all but the first `number` changes; None: there were none."""
        new = self._boxes[number:]
        if not new:
            return None
        first, last = np.min(new, axis=0), np.max(new, axis=0)
        return int(first[0]), int(first[1]), int(last[2]), int(last[3])


class KeptLayer:
    """One layer; its values are cut off at `reach_m`, what depends on more is not kept."""

    def __init__(self, reach_m: float) -> None:
        self._reach_m = reach_m
        self._values: FloatArray | None = None
        self._box: Box = (0, 0, 0, 0)
        self._known_changes = 0

    def on(
        self, grid: Lattice, changes: Changes, work_out: Callable[[slice, slice], FloatArray]
    ) -> FloatArray:
        """(H, W), read-only; `work_out` gives the values of a window of the grid."""
        changed = changes.since(self._known_changes)
        now = (*grid.corner, grid.corner[0] + grid.shape[0], grid.corner[1] + grid.shape[1])
        if self._values is not None and changed is None and self._box == now:
            return self._values
        values = np.full(grid.shape, self._reach_m)
        boxes = [now]
        if self._values is not None:
            boxes = _strips(self._box, now)
            values[_part(self._box, now)] = self._values
        if changed is not None and boxes != [now]:
            boxes.append(changed)
        margin = math.ceil(self._reach_m / grid.resolution_m) + 2
        for box in boxes:
            wider = _wider(box, margin, now)
            asked = _wider(wider, margin, now)
            found = np.minimum(work_out(*_part(asked, now)), self._reach_m)
            values[_part(wider, now)] = found[_part(wider, asked)]
        values.flags.writeable = False
        self._values, self._box, self._known_changes = values, now, len(changes)
        return values


def _strips(old: Box, new: Box) -> list[Box]:
    """What a grid has grown by, on each side."""
    sides = [
        (new[0], new[1], old[0], new[3]),
        (old[2], new[1], new[2], new[3]),
        (new[0], new[1], new[2], old[1]),
        (new[0], old[3], new[2], new[3]),
    ]
    return [side for side in sides if side[0] < side[2] and side[1] < side[3]]


def _part(box: Box, outer: Box) -> tuple[slice, slice]:
    """A box in the array of another."""
    first, begin = outer[:2]
    return slice(box[0] - first, box[2] - first), slice(box[1] - begin, box[3] - begin)


def _wider(box: Box, by: int, most: Box) -> Box:
    """Wider to all sides, within another."""
    return (
        max(box[0] - by, most[0]),
        max(box[1] - by, most[1]),
        min(box[2] + by, most[2]),
        min(box[3] + by, most[3]),
    )
