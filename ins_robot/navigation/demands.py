# SPDX-License-Identifier: MIT
"""What is worth seeing: unseen ground just beyond the edges, and from where it shows.

Unseen ground right behind an edge is probably open, farther on less probably: each point weighs
its share of area by that chance. Only a shell about a metre thick is looked at: what lies
behind it nobody knows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.navigation.outlook import BoolArray, IndexArray, Outlook

AROUND = np.array([(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c])
DEPTHS_M = np.array([0.1, 0.35, 0.6, 0.85, 1.1])
LATTICE_M = 0.3  # points nearer together than this are one
FREE_WAY_M = 1.0  # how far into unseen ground it goes on, on average
RAYS = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Demands:
    """Points worth seeing.

    Attributes
    ----------
    cells : (D, 2) int64
        Unseen cells.
    area_m2 : (D,) float64
        Expected open area each stands for.
    edge_cells : (D, 2) int64
        The edge cell before each.
    """

    cells: IndexArray
    area_m2: FloatArray
    edge_cells: IndexArray

    def part(self, index: IndexArray) -> Demands:
        """Some of them, by index."""
        return Demands(
            cells=self.cells[index],
            area_m2=self.area_m2[index],
            edge_cells=self.edge_cells[index],
        )


def demands_of(outlook: Outlook, edges: IndexArray) -> Demands:
    """Straight on from edge cells (n, 2), as far as all is unseen."""
    resolution, shape = outlook.resolution_m, np.array(outlook.is_unseen.shape)
    near = np.clip(edges[:, None] + AROUND, 0, shape - 1)
    ahead = outlook.is_unseen[near[..., 0], near[..., 1]].astype(float) @ AROUND
    ahead /= np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)[:, None]
    steps = np.maximum(DEPTHS_M / resolution, 1.0)
    cells = np.floor(edges[:, None] + 0.5 + ahead[:, None] * steps[:, None]).astype(np.int64)
    inside = ((cells >= 0) & (cells < shape)).all(axis=-1)
    at = np.where(inside[..., None], cells, 0)
    is_unseen = np.logical_and.accumulate(
        inside & outlook.is_unseen[at[..., 0], at[..., 1]], axis=1
    )
    area = np.exp(-DEPTHS_M / FREE_WAY_M) * (DEPTHS_M[1] - DEPTHS_M[0]) * resolution
    number, depth = np.nonzero(is_unseen)
    found = at[is_unseen]
    pitch = max(1, round(LATTICE_M / resolution))
    key = found[:, 0] // pitch * int(shape[1]) + found[:, 1] // pitch
    _, first, of = np.unique(key, return_index=True, return_inverse=True)
    total = np.bincount(of, area[depth], minlength=len(first))
    return Demands(
        cells=found[first],
        area_m2=np.minimum(total, (pitch * resolution) ** 2),
        edge_cells=edges[number[first]],
    )


def shows_from(
    outlook: Outlook, places: IndexArray, cells: IndexArray, sight_m: float
) -> BoolArray:
    """(P, D) whether a scan at places (P, 2) may show cells (D, 2), unseen ground being clear.

    Rays go from the cells, a tenth of a metre a sample; a place is seen when it lies nearer
    than the ray towards it gets.
    """
    stride = max(1, round(0.1 / outlook.resolution_m))
    reach = round(sight_m / outlook.resolution_m)
    samples = reach // stride
    is_opaque = np.pad(outlook.is_opaque, reach + 1, constant_values=True)
    width = is_opaque.shape[1]
    flat = (cells[:, 0] + reach + 1) * width + cells[:, 1] + reach + 1
    is_clear = ~is_opaque.reshape(-1)
    goes_on = np.ones((len(cells), RAYS), bool)
    free = np.zeros(goes_on.shape, np.uint16)
    for rows, cols in zip(*_along_rays(samples, stride), strict=True):  # all rays a step on
        goes_on &= is_clear.take(flat[:, None] + (rows * width + cols))
        free += goes_on
    far = np.minimum(stride * (free + 0.5), reach)
    place, cell = pairs_near(places, cells, reach)
    row, col = (places[place] - cells[cell] + reach).T
    distance, ray = _window(reach)
    shows = np.zeros((len(places), len(cells)), bool)
    shows[place, cell] = distance[row, col] <= far[cell, ray[row, col]]
    return shows


def pairs_near(
    places: IndexArray, cells: IndexArray, reach: int
) -> tuple[IndexArray, IndexArray]:
    """Indices (N,), (N,) of places (P, 2) and cells (D, 2) no farther apart, axis by axis."""
    places, cells = places.astype(np.int32), cells.astype(np.int32)
    is_near = np.abs(places[:, None, 0] - cells[:, 0]) <= reach
    is_near &= np.abs(places[:, None, 1] - cells[:, 1]) <= reach
    place, cell = np.divmod(np.flatnonzero(is_near), len(cells))
    return place, cell


@lru_cache(maxsize=4)
def _along_rays(samples: int, stride: int) -> tuple[IndexArray, IndexArray]:
    """(samples, RAYS) offsets in rows and columns along rays from a cell's centre."""
    bearings = 2.0 * np.pi * np.arange(RAYS) / RAYS
    along = stride * (1.0 + np.arange(samples)[:, None])
    rows = np.floor(0.5 + np.sin(bearings) * along)
    cols = np.floor(0.5 + np.cos(bearings) * along)
    return rows.astype(np.int64), cols.astype(np.int64)


@lru_cache(maxsize=4)
def _window(reach: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """(2 reach + 1, 2 reach + 1) distance in cells, and number of the ray, of each offset."""
    up, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    ray = np.round(np.arctan2(up, right) * (RAYS / (2.0 * math.pi))).astype(np.int32) % RAYS
    return np.hypot(up, right), ray
