# SPDX-License-Identifier: MIT
"""Layers over a growing grid that are worked out again only around what has changed.

For values that depend on what lies within a certain distance only, such as distances up to it:
a change reaches so far and no farther, and so much around it must be looked at, when that part
is asked for. Kept in blocks where anything is known: growing does not cost the whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Protocol

import numpy as np

from ins_robot.geometry.angles import FloatArray

BLOCK_CELLS = 64
Part = tuple[slice, slice]
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

    def since(self, number: int) -> list[Box]:
        """Boxes around all but the first `number` changes, those that overlap made one."""
        joined: list[Box] = []
        for box in self._boxes[number:]:
            apart = [other for other in joined if not _overlap(box, other)]
            for other in joined:
                if other not in apart:
                    box = _around(box, other)
            joined = [*apart, box]
        return joined


class KeptLayer:
    """One layer; its values are cut off at `reach_m`, what depends on more is not kept.

    Asked for more, it begins anew.

    `unknown` is the value where nothing is known within reach; None: `reach_m`.
    """

    def __init__(self, reach_m: float, unknown: float | None) -> None:
        self.reach_m, self._unknown = reach_m, unknown
        self._blocks: dict[tuple[int, int], FloatArray] = {}
        self._known_changes, self._is_begun = 0, False
        self._stale: list[Box] = []
        self._last: tuple[int, Box, FloatArray] | None = None

    def on(
        self,
        grid: Lattice,
        changes: Changes,
        work_out: Callable[[Part, Part], FloatArray],
        part: Part,
        reach_m: float = 0.0,
    ) -> FloatArray:
        """(h, w), a part of the grid, read-only.

        `work_out` gives the values of a part from what is in another, larger one.
        """
        if reach_m > self.reach_m:
            self.reach_m, self._is_begun, self._last = reach_m, False, None
            self._blocks.clear()
            self._stale.clear()
        top, left = grid.corner
        whole = (top, left, top + grid.shape[0], left + grid.shape[1])
        rows, cols = part
        asked = (rows.start + top, cols.start + left, rows.stop + top, cols.stop + left)
        if self._last is not None and self._last[:2] == (len(changes), asked):
            return self._last[2]
        margin = math.ceil(self.reach_m / grid.resolution_m) + 2
        changed = changes.since(self._known_changes) if self._is_begun else [whole]
        stale = [*self._stale, *(_wider(box, margin, whole) for box in changed)]
        self._known_changes, self._is_begun, self._stale = len(changes), True, []
        for box in stale:
            if not _overlap(box, asked):
                self._stale.append(box)
                continue
            shared = _shared(box, asked)
            found = work_out(_part(shared, whole), _part(_wider(shared, margin, whole), whole))
            self._put(shared, np.minimum(found, self.reach_m))
            self._stale += _strips(shared, box)
        values = np.empty((asked[2] - asked[0], asked[3] - asked[1]))
        for key, inner, outer in _in_blocks(asked):
            block = self._blocks.get(key)
            values[outer] = self._far if block is None else block[inner]
        values.flags.writeable = False
        self._last = len(changes), asked, values
        return values

    @property
    def _far(self) -> float:
        return self.reach_m if self._unknown is None else self._unknown

    def _put(self, box: Box, values: FloatArray) -> None:
        for key, inner, outer in _in_blocks(box):
            block = self._blocks.get(key)
            if block is None:
                block = self._blocks[key] = np.full((BLOCK_CELLS,) * 2, self._far)
            block[inner] = values[outer]


def _in_blocks(
    box: Box,
) -> Iterator[tuple[tuple[int, int], tuple[slice, slice], tuple[slice, slice]]]:
    """Blocks under a box: the name of each, the shared cells in the block and in the box."""
    spans = []
    for first, end in ((box[0], box[2]), (box[1], box[3])):
        numbers = range(first // BLOCK_CELLS, -(-end // BLOCK_CELLS))
        starts = [max(first, n * BLOCK_CELLS) for n in numbers]
        stops = [min(end, (n + 1) * BLOCK_CELLS) for n in numbers]
        spans.append(list(zip(numbers, starts, stops, strict=True)))
    for (i, top, bottom), (j, left, right) in product(*spans):
        row, col = i * BLOCK_CELLS, j * BLOCK_CELLS
        inner = slice(top - row, bottom - row), slice(left - col, right - col)
        outer = slice(top - box[0], bottom - box[0]), slice(left - box[1], right - box[1])
        yield (i, j), inner, outer


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _shared(a: Box, b: Box) -> Box:
    return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


def _strips(inner: Box, outer: Box) -> list[Box]:
    """What a box has around one within."""
    sides = [
        (outer[0], outer[1], inner[0], outer[3]),
        (inner[2], outer[1], outer[2], outer[3]),
        (inner[0], outer[1], inner[2], inner[1]),
        (inner[0], inner[3], inner[2], outer[3]),
    ]
    return [side for side in sides if side[0] < side[2] and side[1] < side[3]]


def _around(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def part_of(part: Part, outer: Part) -> Part:
    """A part of a grid in the array of another one that holds it."""
    rows, cols = (
        slice(a.start - b.start, a.stop - b.start) for a, b in zip(part, outer, strict=True)
    )
    return rows, cols


def _part(box: Box, outer: Box) -> Part:
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
