# SPDX-License-Identifier: MIT
"""Exact traversal of a grid by many rays at once; shared by the map and the simulated LRF.

A ray enters a cell only where it crosses a column line or a row line. Either family of
crossings is equally spaced along the ray (Amanatides & Woo 1987), so both are looked up as
whole arrays, and the nearer of the two first hits is exact: no stepping, no cell-sized error.
Cells are (row, col), row grows with +y; the point (row, col) = (2.5, 3.5) is a cell's centre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray

IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_PARALLEL = 1e-9
"""A ray this parallel to a family of lines crosses it a billion cells away."""
_SLAB = 32
"""Crossings of a ray looked up before rays that have found something are dropped (measured)."""
_LOOKUPS = 4000
"""So few lookups cost no more than the calls around them: few rays, longer slabs (measured)."""
_BLOCK = 600
"""Rays worked on at once, so that a slab stays in a small processor's cache (measured)."""


def cast_rays(
    is_blocked: BoolArray,
    start_cells: FloatArray,
    bearings_rad: FloatArray,
    range_max_cells: float,
) -> FloatArray:
    """Distance along each ray to the boundary of the first blocked cell.

    Outside the grid everything is blocked. A start in a blocked cell gives 0. A ray through the
    very corner of two diagonal cells may pass between them.

    Parameters
    ----------
    is_blocked : (H, W) bool
    start_cells : (N, 2) or (1, 2) float64
        (row, col), continuous; one row serves all bearings.
    bearings_rad : (N,) float64
        Counter-clockwise from +col (x) towards +row (y).
    range_max_cells : float

    Returns
    -------
    (N,) float64
        In cells; inf where nothing was hit within the range.
    """
    bearings = np.asarray(bearings_rad, dtype=np.float64)
    starts = _one_start_each(start_cells, bearings)
    flat = np.ascontiguousarray(is_blocked).reshape(-1)
    if bearings.size <= _BLOCK:
        return _cast_block(flat, is_blocked.shape, starts, bearings, range_max_cells)
    blocks = [slice(first, first + _BLOCK) for first in range(0, bearings.size, _BLOCK)]
    return np.concatenate(
        [
            _cast_block(flat, is_blocked.shape, starts[b], bearings[b], range_max_cells)
            for b in blocks
        ]
    )


def cells_on_rays(
    shape: tuple[int, int],
    start_cells: FloatArray,
    bearings_rad: FloatArray,
    distances_cells: FloatArray,
) -> tuple[IndexArray, IndexArray]:
    """Cells each ray is in before it has gone its distance, the start cell included.

    With the distances of `cast_rays` (clipped to the range) these are exactly the free cells
    the ray sees; the cell that stopped it is not among them. A distance of 0 names no cell.

    Parameters
    ----------
    shape : (H, W)
    start_cells : (N, 2) or (1, 2) float64
        As in `cast_rays`.
    bearings_rad, distances_cells : (N,) float64
        Distances must be finite.

    Returns
    -------
    flat, ray : (M,) int64
        Index into the flattened grid, and the number of the ray. One ray names a cell once;
        rays that share a cell each name it (count with `bincount`, merge in a bool grid).
        Not ordered along the ray. Cells outside the grid are left out.
    """
    bearings = np.asarray(bearings_rad, dtype=np.float64)
    starts = _one_start_each(start_cells, bearings)
    count, (height, width) = bearings.size, shape
    lines = _crossings(starts, bearings, shape)
    limit = np.minimum(distances_cells, lines.leaves)
    # Crossings strictly before the limit; the slack keeps rounding from entering the stopper.
    crossed = np.ceil((np.tile(limit, 2) - lines.first) / lines.pitch - _PARALLEL)
    counts = np.maximum(crossed, 0.0).astype(np.int64)
    family = np.repeat(np.arange(2 * count), counts)
    k = np.arange(family.size) - np.repeat(np.cumsum(counts) - counts, counts)
    entered = lines.line[family] + lines.way[family] * k
    beside = np.floor(lines.minor[family] + lines.slope[family] * k).astype(np.int64)
    is_column_line = family < count
    row = np.where(is_column_line, beside, entered)
    col = np.where(is_column_line, entered, beside)
    is_inside = (row >= 0) & (col >= 0) & (row < height) & (col < width)
    began = np.flatnonzero(limit > 0.0)
    first_cell = np.floor(starts[began]).astype(np.int64)
    return (
        np.concatenate(
            [first_cell[:, 0] * width + first_cell[:, 1], (row * width + col)[is_inside]]
        ),
        np.concatenate([began, np.where(is_column_line, family, family - count)[is_inside]]),
    )


class _Crossings(NamedTuple):
    """The 2N families of crossings: N rays with column lines, then N rays with row lines.

    Crossing k of a family lies `first + k * pitch` along the ray. It enters the cell with index
    `line + k * way` across the lines and `floor(minor + k * slope)` along them. Each (2N,).
    `leaves`, (N,), is how far each ray goes inside the grid; 0 when it starts outside.
    """

    first: FloatArray
    pitch: FloatArray
    minor: FloatArray
    slope: FloatArray
    line: IndexArray
    way: IndexArray
    leaves: FloatArray


def _crossings(starts: FloatArray, bearings: FloatArray, shape: tuple[int, ...]) -> _Crossings:
    count = bearings.size
    cos, sin = np.cos(bearings), np.sin(bearings)
    direction, other_direction = np.concatenate([cos, sin]), np.concatenate([sin, cos])
    origin = np.concatenate([starts[:, 1], starts[:, 0]])
    other_origin = np.concatenate([starts[:, 0], starts[:, 1]])
    cell = np.floor(origin)
    is_up = direction >= 0.0
    pitch = 1.0 / np.maximum(np.abs(direction), _PARALLEL)
    first = np.abs(cell + is_up - origin) * pitch
    last = np.repeat([shape[1] - 1.0, shape[0] - 1.0], count)
    leaves = first + np.where(is_up, last - cell, cell) * pitch
    leaves[(cell < 0.0) | (cell > last)] = 0.0
    way = np.where(is_up, 1, -1)
    return _Crossings(
        first,
        pitch,
        other_origin + first * other_direction,
        other_direction * pitch,
        cell.astype(np.int64) + way,
        way,
        np.minimum(leaves[:count], leaves[count:]),
    )


def _cast_block(
    flat: BoolArray,
    shape: tuple[int, ...],
    starts: FloatArray,
    bearings: FloatArray,
    range_max: float,
) -> FloatArray:
    """`cast_rays` on a flattened grid, for rays few enough to be worked on together."""
    count, width = bearings.size, shape[1]
    lines = _crossings(starts, bearings, shape)
    # Flat index of a crossing = floor(minor + k slope) * across + (line + k way) * along. What
    # a ray finds once it has left the grid is nonsense, but lies beyond `leaves`: not counted.
    across, along = np.repeat([width, 1], count), np.repeat([1, width], count)
    base, stride = lines.line * along, lines.way * along
    nearest = lines.leaves
    start_cell = np.floor(starts).astype(np.int64)
    nearest[flat.take(start_cell[:, 0] * width + start_cell[:, 1], mode="clip")] = 0.0
    alive, reached = np.arange(2 * count), lines.first
    last = int(range_max) + 2
    slab = min(last, max(_SLAB, _LOOKUPS // max(1, 2 * count)))
    for k0 in range(0, last, slab):
        ray = alive % count
        going = reached < np.minimum(nearest, range_max)[ray]
        alive, ray = alive[going], ray[going]
        if alive.size == 0:
            break
        k = np.arange(k0, k0 + slab)
        index = (lines.minor[alive, None] + lines.slope[alive, None] * k).astype(np.int64)
        index *= across[alive, None]
        index += base[alive, None] + stride[alive, None] * k
        is_hit = flat.take(index, mode="clip")
        at = is_hit.argmax(axis=1)
        was_hit = is_hit[np.arange(alive.size), at]
        distance = lines.first[alive] + (k0 + at) * lines.pitch[alive]
        np.minimum.at(nearest, ray[was_hit], distance[was_hit])
        alive = alive[~was_hit]
        reached = lines.first[alive] + (k0 + slab) * lines.pitch[alive]
    return np.where(nearest <= range_max, nearest, np.inf)


def _one_start_each(start_cells: FloatArray, bearings: FloatArray) -> FloatArray:
    starts = np.asarray(start_cells, dtype=np.float64)
    return np.broadcast_to(starts, (bearings.size, 2))
