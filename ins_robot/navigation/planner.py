# SPDX-License-Identifier: MIT
"""From the wave to a path an omni base can follow: way cells in, `PlannedPath` out.

The cells' staircase is pulled straight wherever the straight line keeps the clearance the
staircase had; the heading turns evenly along the way to the one wanted at the goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.node_graph import Node
from ins_robot.navigation.squeeze import roomiest_places
from ins_robot.navigation.terrain import EASE_M, IndexArray, Terrain

SAMPLE_CELLS = 0.5  # straight lines are checked this finely
NEAR_CELLS = 4  # how far from a node its nearest reachable cell may be
ROUNDING_M = 0.01  # clearance a straight line may lose against the staircase, if it has more
SAME_ROOM_M = 1e-3  # less than this is no difference


def plan(
    terrain: Terrain, start: Pose2, goal_cell: tuple[int, int], heading_rad: float
) -> PlannedPath:
    """Path from the robot to a reachable cell, arriving with a heading."""
    points = way_points_m(terrain, start, terrain.way_to(goal_cell))
    return with_headings(points, start.heading_rad, heading_rad)


def plan_through(
    terrain: Terrain,
    start: Pose2,
    via: list[Node],
    goal_cell: tuple[int, int],
    heading_rad: float,
) -> PlannedPath:
    """As `plan`, but over nodes in order, on the ways driven before where still free."""
    if len(via) < 2:  # noqa: PLR2004 - one node is where the robot is
        return plan(terrain, start, goal_cell, heading_rad)
    legs: list[FloatArray] = []
    here, ground = start, terrain
    for last, node in pairwise(via):
        leg = _driven(last, node)
        if leg is None or not _is_drivable(terrain, leg):
            cell = _reachable_near(ground, node.position_m)
            if cell is None:
                return plan(terrain, start, goal_cell, heading_rad)
            leg = way_points_m(ground, here, ground.way_to(cell))
        legs.append(leg)
        here = Pose2(float(leg[-1, 0]), float(leg[-1, 1]), 0.0)
        ground = terrain.seen_from(here)
    if not np.isfinite(ground.cost_m[goal_cell]):
        return plan(terrain, start, goal_cell, heading_rad)
    legs.append(way_points_m(ground, here, ground.way_to(goal_cell)))
    points = np.concatenate([[[start.x_m, start.y_m]], *legs])
    moved = np.hypot(*np.diff(points, axis=0).T) > 0.0
    points = points[np.concatenate([[True], moved])]
    return with_headings(points, start.heading_rad, heading_rad)


def _driven(last: Node, node: Node) -> FloatArray | None:
    """(N, 2) the way driven between two nodes, in the direction wanted; None if not driven."""
    if node.came_from == last.index and len(node.came_by_m):
        return last.pose.apply(node.came_by_m)
    if last.came_from == node.index and len(last.came_by_m):
        return node.pose.apply(last.came_by_m)[::-1]
    return None


def _is_drivable(terrain: Terrain, points: FloatArray) -> bool:
    """Whether the ways between points (N, 2) are all drivable, ends excepted."""
    step = terrain.grid.resolution_m
    for a, b in pairwise(points):
        count = max(2, math.ceil(math.hypot(*(b - a)) / step))
        at = terrain.grid.cells(a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a))
        if not np.isfinite(terrain.factor[at[:, 0], at[:, 1]]).all():
            return False
    return True


def _reachable_near(terrain: Terrain, point_m: FloatArray) -> tuple[int, int] | None:
    """The reachable cell nearest to a point, at most NEAR_CELLS away."""
    row, col = (int(v) for v in terrain.grid.cells(point_m))
    first = max(row - NEAR_CELLS, 0), max(col - NEAR_CELLS, 0)
    window = terrain.cost_m[first[0] : row + NEAR_CELLS + 1, first[1] : col + NEAR_CELLS + 1]
    cells = np.argwhere(np.isfinite(window)) + first
    if len(cells) == 0:
        return None
    nearest = cells[int(((cells - (row, col)) ** 2).sum(axis=1).argmin())]
    return int(nearest[0]), int(nearest[1])


def way_points_m(terrain: Terrain, start: Pose2, cells: IndexArray) -> FloatArray:
    """(N, 2) way points of a way of cells, pulled straight; the first is the robot's place.

    Odd cells are passed one by one, at the places they are open at; other cells with little
    room where in them there is most.
    """
    points, is_odd = terrain.places_m(cells)
    room = terrain.clearance_m[cells[:, 0], cells[:, 1]]
    tight = np.flatnonzero(~is_odd & (room < terrain.body.keep_m))
    points[tight], room[tight] = roomiest_places(terrain.grid, cells[tight])
    points[0] = start.x_m, start.y_m
    walls = cache(lambda: terrain.grid.walls_near(points))
    fixed = np.flatnonzero(is_odd[1:-1]) + 1
    kept = [0]
    for stop in [*fixed.tolist(), len(points) - 1]:
        if stop == kept[-1]:
            continue
        stretch = slice(kept[-1], stop + 1)
        straight = _pull_straight(terrain, points[stretch], room[stretch], walls)
        base = kept[-1]
        kept.extend(base + index for index in straight[1:])
    return points[kept]


def with_headings(points_m: FloatArray, start_rad: float, goal_rad: float) -> PlannedPath:
    """Headings that turn the short way round, evenly along the path."""
    steps = np.hypot(*np.diff(points_m, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(along))
    headings = wrap_rad(start_rad + wrap_rad(goal_rad - start_rad) * share)
    if len(points_m) == 1:  # turning on the spot
        points_m = np.repeat(points_m, 2, axis=0)
        headings = np.array([start_rad, goal_rad])
    return PlannedPath(points_m=points_m, headings_rad=np.asarray(headings))


def dense_points_m(points_m: FloatArray, step_m: float) -> FloatArray:
    """(M, 2) points (N, 2) of a path and points between them, at most `step_m` apart."""
    pieces = [points_m[:1]]
    for a, b in pairwise(points_m):
        count = max(1, math.ceil(math.hypot(*(b - a)) / step_m))
        pieces.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.concatenate(pieces)


def _pull_straight(
    terrain: Terrain, points: FloatArray, room: FloatArray, walls: Callable[[], cKDTree]
) -> list[int]:
    """Indices of the way points kept: from each the farthest one that a straight line reaches.

    `room` (N,) is what there is at the points (N, 2).

    Doubling, then halving: a line is tried a few times a corner instead of once a cell.
    """
    enough = terrain.body.radius_m + terrain.body.clearance_m + EASE_M
    room = np.minimum(room, enough)
    last = len(points) - 1
    kept = [0]
    while kept[-1] < last:
        here = kept[-1]
        good, step = here + 1, 2
        bad = last + 1
        while good < last:
            tried = min(here + step, last)
            if not _is_clear(terrain, points, room, (here, tried), walls):
                bad = tried
                break
            good, step = tried, 2 * step
        while bad - good > 1:
            tried = (good + bad) // 2
            if tried > last:
                break
            if _is_clear(terrain, points, room, (here, tried), walls):
                good = tried
            else:
                bad = tried
        kept.append(good)
    return kept


def _is_clear(
    terrain: Terrain,
    points: FloatArray,
    room: FloatArray,
    ends: tuple[int, int],
    walls: Callable[[], cKDTree],
) -> bool:
    """Whether the line between two points is drivable and as roomy as the way there."""
    a, b = ends
    length = math.hypot(*(points[b] - points[a]))
    count = max(2, math.ceil(length / (SAMPLE_CELLS * terrain.grid.resolution_m)))
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    line = points[a] + share * (points[b] - points[a])
    at = terrain.grid.cells(line)
    rows, cols = at[:, 0], at[:, 1]
    if not np.isfinite(terrain.factor[rows, cols]).all():
        return False
    least = float(room[a : b + 1].min())
    needed = min(least, max(least - ROUNDING_M, terrain.body.keep_m))
    near = terrain.clearance_m[rows, cols] < needed + terrain.grid.resolution_m
    return not near.any() or bool((walls().query(line[near])[0] >= needed - SAME_ROOM_M).all())
