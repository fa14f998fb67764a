# SPDX-License-Identifier: MIT
"""Which free cells can be seen at all, within range from where the robot's centre can get.

From a lattice of reachable places and the start, 720 rays each. A cell counts as seen from a
place when its centre is nearer than the ray that passes it goes. All places are cell centres,
so the distance and the ray of every cell around are the same for each: one window, shifted.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.simulation.world import World

LATTICE_M = 0.4
RAYS = 720
_SLACK_CELLS = 0.5
"""A cell whose centre lies this little behind the end of its ray still counts as seen."""


def visible_cells(
    world: World, start: Pose2, radius_m: float, range_max_m: float
) -> NDArray[np.bool_]:
    """(H, W) bool: free cells that a robot of this radius could see, set down at `start`."""
    walls = world.is_occupied
    reach = range_max_m / world.resolution_m
    pad = math.ceil(reach)
    up, right = np.mgrid[-pad : pad + 1, -pad : pad + 1]
    distance = np.hypot(up, right)
    ray = np.round(np.arctan2(up, right) * (RAYS / (2.0 * np.pi))).astype(np.int64) % RAYS
    distance = np.where(distance <= reach, distance, np.inf).astype(np.float32)
    bearings = np.arange(RAYS, dtype=np.float64) * (2.0 * np.pi / RAYS)
    is_visible = np.zeros((walls.shape[0] + 2 * pad, walls.shape[1] + 2 * pad), dtype=bool)
    for row, col in _places(world, start, radius_m):
        free_way = cast_rays(walls, np.array([[row + 0.5, col + 0.5]]), bearings, reach)
        free_way = (np.minimum(free_way, reach) + _SLACK_CELLS).astype(np.float32)
        window = is_visible[row : row + 2 * pad + 1, col : col + 2 * pad + 1]
        window |= distance <= free_way[ray]
    inner = is_visible[pad : pad + walls.shape[0], pad : pad + walls.shape[1]]
    visible: NDArray[np.bool_] = inner & ~walls
    return visible


def _places(world: World, start: Pose2, radius_m: float) -> list[tuple[int, int]]:
    """Reachable cells (row, col) on a lattice, and the start's."""
    is_reachable = world.reachable(start, radius_m)
    pitch = max(1, round(LATTICE_M / world.resolution_m))
    lattice = np.argwhere(is_reachable[::pitch, ::pitch]) * pitch
    start_cell = np.floor(world.cells((start.x_m, start.y_m))).astype(np.int64)
    return [(int(row), int(col)) for row, col in [*lattice, start_cell]]
