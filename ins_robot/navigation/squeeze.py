# SPDX-License-Identifier: MIT
"""The last resort: passages that fit the body but not the grid's cells.

A cell's centre can be off a narrow passage's middle by half a cell, which is all the room there
is between furniture 0.45 m apart. The readings know better than cells where the walls are: for
free cells on the ridge between two walls the place within the cell with the most room is found,
and the robot drives from such place to such place. Quiet ground counts as free: where a narrow
door leads to a large room, nothing behind it answers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.neighbourhood import set_cells
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.terrain import MARGIN_CELLS, BodyRules, IndexArray, OddCells

ROOM_M = 0.015  # least room left around the body
RIDGE_CELLS = 0.6  # a ridge cell is at most this much nearer to a wall than its neighbours
STRAY_M = 0.01  # one reading may be off by so much; on a surface the next lies beside it
SUB_PLACES = 5  # places tried per cell and axis
BoolArray = NDArray[np.bool_]


def find_squeezes(grid: OccupancyGrid, body: BodyRules, is_unseen: BoolArray) -> OddCells:
    """Cells that are drivable at a certain place in them, beyond what their centres allow."""
    cells = set_cells(_between_walls(grid, body, is_unseen))
    if len(cells) == 0:
        return OddCells.none()
    places, room = roomiest_places(grid, cells)
    fits = room >= body.radius_m + ROOM_M
    return OddCells(cells=cells[fits], places_m=places[fits])


def roomiest_places(grid: OccupancyGrid, cells: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) the places in cells (N, 2) farthest from walls, map frame; (N,) how far."""
    steps = ((np.arange(SUB_PLACES) + 0.5) / SUB_PLACES - 0.5) * grid.resolution_m
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = grid.metres(cells)[:, None] + shifts
    if len(cells) == 0:
        return places[:, 0], np.zeros(0)
    walls = grid.walls_near(places.reshape(-1, 2))
    nearest, next_m = walls.query(places.reshape(-1, 2), k=2)[0].T
    room = np.minimum(next_m, nearest + STRAY_M).reshape(len(cells), len(shifts))
    each, best = np.arange(len(cells)), room.argmax(axis=1)
    return places[each, best], room[each, best]


def _between_walls(grid: OccupancyGrid, body: BodyRules, is_unseen: BoolArray) -> BoolArray:
    """(H, W) free cells too near to walls, on or beside a ridge of the distance to them.

    With up to a cell more room only those right on it: specks behind the walls may close them,
    but before a single wall a speck may be a leg.
    """
    resolution = grid.resolution_m
    clearance = grid.clearance_m(body.wide_m)
    needed = body.radius_m + MARGIN_CELLS * resolution
    is_quiet = grid.is_unknown & grid.is_quiet
    is_band = (grid.is_free | is_quiet) & (clearance >= body.radius_m - resolution)
    is_band &= clearance < needed + resolution
    is_unseen = is_unseen & ~is_quiet
    if is_unseen.any():
        unseen_m = distance_transform_edt(~is_unseen, sampling=resolution)
        is_band &= unseen_m - 0.5 * resolution >= body.radius_m
    is_between = is_band & (
        clearance >= maximum_filter(clearance, size=3) - RIDGE_CELLS * resolution
    )
    is_band &= clearance < needed
    around = maximum_filter(np.minimum(clearance, needed), size=3)
    is_ridge = is_band & (clearance >= around - RIDGE_CELLS * resolution)
    return np.asarray((is_band & maximum_filter(is_ridge, size=3)) | is_between)
