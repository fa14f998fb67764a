# SPDX-License-Identifier: MIT
"""The magnetic field in a building: the earth's, and what metal objects do to it.

Objects (radiators, reinforcement, appliances) stand at random places; near one the field turns
by tens of degrees, as it does indoors. World frame, gauss; north is +y.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.simulation.world import World

_EARTH_HORIZONTAL = 0.2
_EARTH_DOWN = 0.4
_OBJECTS_PER_M2 = 0.12
_OBJECTS_MAX = 40
_STRENGTH_STD = 0.02
_CORE_M = 0.35
"""Size of an object: nearer than this its field grows no more."""


class MagneticField:
    """Earth's field plus dipole-like objects.

    Parameters
    ----------
    world : World
    strength : float
        Scales the objects; 0 = none.
    rng : numpy.random.Generator
        Where they stand and how strong they are.
    """

    def __init__(self, world: World, strength: float, rng: np.random.Generator) -> None:
        free = np.argwhere(~world.is_occupied)
        area_m2 = len(free) * world.resolution_m**2
        count = min(_OBJECTS_MAX, round(area_m2 * _OBJECTS_PER_M2)) if strength > 0.0 else 0
        places = world.metres(free[rng.integers(len(free), size=count)] + 0.5)
        moments = rng.standard_normal((count, 3)) * _STRENGTH_STD * strength
        self._objects: list[list[float]] = np.hstack([places, moments]).tolist()

    def at(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """(x, y, z) of the field in gauss, world frame."""
        fx, fy, fz = 0.0, _EARTH_HORIZONTAL, -_EARTH_DOWN
        for object_x, object_y, mx, my, mz in self._objects:
            dx, dy = x_m - object_x, y_m - object_y
            squared = dx * dx + dy * dy + _CORE_M * _CORE_M
            # Field of a dipole, up to its constant: (3 (m . u) u - m) / r^3.
            scale = 1.0 / (squared * math.sqrt(squared))
            along = 3.0 * (mx * dx + my * dy) / squared
            fx += scale * (along * dx - mx)
            fy += scale * (along * dy - my)
            fz -= scale * mz
        return fx, fy, fz
