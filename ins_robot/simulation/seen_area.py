# SPDX-License-Identifier: MIT
"""What the simulated LRF has really seen: the free cells inside the wedges of its beams.

A beam that was measured, or that truly met nothing within the range, sees a wedge of +-0.5 deg
up to its own true length, as far as the walls let each part of the wedge through. Beams are
collected and marked in batches; of beams from one place in one direction only the longest is
kept, so that five revolutions cost one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.ray_cast import cast_rays, cells_on_rays
from ins_robot.simulation.world import World

_BATCH = 4096
_WEDGE_RAD = np.radians([-0.25, 0.25])
"""Rays that fill a wedge, 0.05 m apart at 6 m: each stands for one half of it."""
_SAME_PLACE_M = 0.02
_SAME_BEARING_RAD = math.radians(0.5)


class SeenArea:
    """A bool grid over the world, marked lazily."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._is_seen = np.zeros(world.is_occupied.shape, dtype=bool)
        self._batch: list[FloatArray] = []
        self._waiting = 0

    def add(
        self, x_m: FloatArray, y_m: FloatArray, bearing_rad: FloatArray, length_m: FloatArray
    ) -> None:
        """Beams (N,) from points in the world frame, each seen up to `length_m`."""
        self._batch.append(np.stack([x_m, y_m, bearing_rad, length_m], axis=1))
        self._waiting += len(x_m)
        if self._waiting >= _BATCH:
            self._mark()

    def is_seen(self) -> NDArray[np.bool_]:
        """(H, W) bool: free cells seen so far."""
        self._mark()
        return self._is_seen.copy()

    def _mark(self) -> None:
        if not self._waiting:
            return
        beams = _longest_of_the_same(np.concatenate(self._batch))
        self._batch, self._waiting = [], 0
        scale = self._world.resolution_m
        starts = np.repeat(self._world.cells(beams[:, :2]), _WEDGE_RAD.size, axis=0)
        bearings = (beams[:, 2, None] + _WEDGE_RAD).reshape(-1)
        lengths = np.repeat(beams[:, 3] / scale, _WEDGE_RAD.size)
        walls = self._world.is_occupied
        reach = cast_rays(walls, starts, bearings, float(lengths.max()))
        flat, _ = cells_on_rays(walls.shape, starts, bearings, np.minimum(reach, lengths))
        self._is_seen.reshape(-1)[flat] = True


def _longest_of_the_same(beams: FloatArray) -> FloatArray:
    """(M, 4) the longest beam of each place and direction, in order of place."""
    pitch = (_SAME_PLACE_M, _SAME_PLACE_M, _SAME_BEARING_RAD)
    keys = np.round(beams[:, :3] / pitch).astype(np.int64)
    order = np.lexsort((-beams[:, 3], keys[:, 2], keys[:, 1], keys[:, 0]))
    keys = keys[order]
    is_first = np.ones(len(keys), dtype=bool)
    is_first[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    return beams[order[is_first]]
