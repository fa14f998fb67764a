# SPDX-License-Identifier: MIT
"""The last resort: passages that fit the body but not the grid's cells.

A cell's centre can be off a narrow passage's middle by half a cell, which is all the room there
is between furniture 0.45 m apart. There the nearby scans' own end points tell better than cells
where the walls are: for free cells on the ridge between two walls the place within the cell
with the most room is found, and the robot drives from such place to such place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter
from scipy.spatial import cKDTree

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.terrain import MARGIN_CELLS, BodyRules, OddCells

ROOM_M = 0.015  # least room left around the body
HIT_RANGE_M = 2.0  # readings up to here place a wall to some millimetres
COVERED_CELLS = 1.0  # an occupied cell this near to such a reading is told by it
RIDGE_CELLS = 0.6  # a ridge cell is at most this much nearer to a wall than its neighbours
SUB_PLACES = 5  # places tried per cell and axis
BoolArray = NDArray[np.bool_]


def find_squeezes(
    grid: OccupancyGrid, graph: NodeGraph, body: BodyRules, is_unseen: BoolArray
) -> OddCells:
    """Cells that are drivable at a certain place in them, beyond what their centres allow."""
    cells = np.argwhere(_between_walls(grid, body, is_unseen))
    walls = _wall_points_m(grid, graph)
    if len(cells) == 0 or len(walls) == 0:
        return OddCells.none()
    steps = ((np.arange(SUB_PLACES) + 0.5) / SUB_PLACES - 0.5) * grid.resolution_m
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = grid.metres(cells)[:, None] + shifts
    room, _ = cKDTree(walls).query(places.reshape(-1, 2))
    room = room.reshape(len(cells), -1)
    best = room.argmax(axis=1)
    fits = room.max(axis=1) >= body.radius_m + ROOM_M
    return OddCells(cells=cells[fits], places_m=places[np.flatnonzero(fits), best[fits]])


def _between_walls(grid: OccupancyGrid, body: BodyRules, is_unseen: BoolArray) -> BoolArray:
    """(H, W) free cells too near to walls, on or beside a ridge of the distance to them."""
    resolution = grid.resolution_m
    distance = grid.distance_m()
    needed = body.radius_m + (MARGIN_CELLS + 0.5) * resolution
    is_band = grid.is_free & (distance >= body.radius_m - resolution) & (distance < needed)
    if is_unseen.any():
        unseen_m = distance_transform_edt(~is_unseen, sampling=resolution)
        is_band &= unseen_m - 0.5 * resolution >= body.radius_m
    around = maximum_filter(np.minimum(distance, needed), size=3)
    is_ridge = is_band & (distance >= around - RIDGE_CELLS * resolution)
    return np.asarray(is_band & maximum_filter(is_ridge, size=3))


def _wall_points_m(grid: OccupancyGrid, graph: NodeGraph) -> FloatArray:
    """(N, 2) end points of near readings; corners of the occupied cells they do not tell of."""
    points = [np.zeros((0, 2))]
    for node in graph.nodes:
        near = node.ranges_m <= HIT_RANGE_M
        ranges, bearings = node.ranges_m[near], node.bearings_rad[near]
        ends = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
        points.append(node.pose.apply(ends))
    hits = np.concatenate(points)
    centres = grid.metres(np.argwhere(grid.is_occupied))
    if len(hits) and len(centres):
        away, _ = cKDTree(hits).query(centres)
        centres = centres[away > COVERED_CELLS * grid.resolution_m]
    half = 0.5 * grid.resolution_m
    corners = np.array([[-half, -half], [-half, half], [half, -half], [half, half]])
    return np.concatenate([hits, (centres[:, None] + corners).reshape(-1, 2)])
