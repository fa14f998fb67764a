# SPDX-License-Identifier: MIT
"""What the walls are made of: which way they face, and how well they throw light back.

Both are fields over the grid, made once from the walls alone: the same building looks the same
in every run. Normals come from walls smoothed over 0.1 m, so that the staircase which a slanted
wall is on a grid faces the way the wall does. Reflectivity varies along walls, in patches.
"""

from __future__ import annotations

import zlib

import numpy as np
from scipy import ndimage

from ins_robot.geometry.angles import FloatArray
from ins_robot.simulation.world import World

_SMOOTHING_M = 0.1
_PATCH_M = 0.15
REFLECTIVITY_MEDIAN = 0.5
_REFLECTIVITY_RANGE = (0.002, 0.95)


class Surfaces:
    """Fields over the cells of a world, looked up at the points where beams end.

    `spread` is the standard deviation of the natural logarithm of reflectivity.
    """

    def __init__(self, world: World, spread: float) -> None:
        scale = world.resolution_m
        blurred = ndimage.gaussian_filter(
            world.is_occupied.astype(np.float32), max(1.0, _SMOOTHING_M / scale), mode="nearest"
        )
        up, right = np.gradient(blurred)
        length = np.hypot(up, right)
        length[length == 0.0] = np.inf  # inside broad walls: no face, no beam ends there
        self._normal_x, self._normal_y = (
            (-right / length).reshape(-1),
            (-up / length).reshape(-1),
        )
        # Seeded by the walls themselves.
        rng = np.random.Generator(np.random.PCG64(zlib.crc32(world.is_occupied.tobytes())))
        texture = ndimage.gaussian_filter(
            rng.standard_normal(world.is_occupied.shape, dtype=np.float32),
            _PATCH_M / scale,
            mode="wrap",
        )
        texture *= spread / max(float(texture.std()), 1e-9)
        self._reflectivity = np.clip(
            REFLECTIVITY_MEDIAN * np.exp(texture), *_REFLECTIVITY_RANGE
        ).reshape(-1)

    def reflectivity(self, flat: np.ndarray) -> FloatArray:
        """(N,) share of light thrown back, 0..1, at flat cell indices (N,)."""
        share: FloatArray = self._reflectivity.take(flat, mode="clip").astype(np.float64)
        return share

    def incidence_cos(self, flat: np.ndarray, cos: FloatArray, sin: FloatArray) -> FloatArray:
        """(N,) cosine of the angle between beams (cos, sin) and the walls' normals, 0..1."""
        facing = self._normal_x.take(flat, mode="clip") * cos
        facing += self._normal_y.take(flat, mode="clip") * sin
        cosine: FloatArray = np.clip(-facing, 0.0, 1.0).astype(np.float64)
        return cosine
