# SPDX-License-Identifier: MIT
"""Drives that are for no gap: home at the end, to a place somebody named, back for a new look.

A scene and a place in, a path out, or why there is none.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.planner import way_points_m, with_headings
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.terrain import Terrain

AT_HOME_M = 0.08  # nearer than this is there
AT_HOME_RAD = math.radians(5.0)  # and turned less: zones lie as the next run's first heading
TRIES = 12  # decisions for one place before it is given up
ROUND_M = 3.0  # cells near to one cost at most this much more
NEAR_M = 0.25  # a place whose own cell is too tight is reached as nearly as this


def trip(scene: Scene, place_m: FloatArray, heading_rad: float | None) -> PlannedPath | None:
    """Path to a place (2,), or next to it; None when no known way leads there."""
    cell = _cell_near(scene.terrain, place_m)
    while not _is_known(scene, cell) and scene.widen():
        cell = _cell_near(scene.terrain, place_m)
    if cell is None and scene.squeeze():
        cell = _cell_near(scene.terrain, place_m)
    if cell is None:
        return None
    points = way_points_m(scene.terrain, scene.pose, scene.terrain.way_to(cell))
    if heading_rad is not None and cell == tuple(scene.grid.cells(place_m).tolist()):
        points[-1] = place_m  # home to the centimetre: there the body has stood
    if heading_rad is None:
        ahead = points[-1] - points[-2] if len(points) > 1 else np.zeros(2)
        is_way = math.hypot(*ahead) > 0.0
        heading_rad = math.atan2(ahead[1], ahead[0]) if is_way else scene.pose.heading_rad
    return with_headings(points, scene.pose.heading_rad, heading_rad)


def is_at_home(pose: Pose2, home: Pose2) -> bool:
    """Whether a run that began at `home` would begin the same at `pose`."""
    off_rad = abs(wrap_rad(pose.heading_rad - home.heading_rad))
    return pose.distance_m(home) <= AT_HOME_M and off_rad <= AT_HOME_RAD


def way_m(terrain: Terrain, place_m: FloatArray) -> float | None:
    """Length of the cheapest way to a place (2,); None when no known way leads there."""
    cell = _cell_near(terrain, place_m)
    if cell is None:
        return None
    points, _ = terrain.places_m(terrain.way_to(cell))
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def way_home_m(scene: Scene, graph: NodeGraph) -> float | None:
    """Length of the cheapest way to the first node; None when no known way leads there.

    Where that is farther than the scene reaches: over the best node within reach, and from
    there as it was when the robot stood there.
    """
    newest = graph.nodes[-1]
    direct_m = way_m(scene.terrain, graph.nodes[0].position_m)
    while direct_m is None and math.isfinite(scene.reach_m):
        positions, home_m = graph.positions_m(), np.array([node.home_m for node in graph.nodes])
        best = int((scene.terrain.cost_near_m(positions) + home_m).argmin())
        part_m = way_m(scene.terrain, positions[best])
        if part_m is not None:
            direct_m = part_m + float(home_m[best])
        elif scene.widen():
            direct_m = way_m(scene.terrain, graph.nodes[0].position_m)
    if direct_m is not None and scene.pose.distance_m(newest.pose) <= NEAR_M:
        newest.home_m = direct_m
    return direct_m


def _is_known(scene: Scene, cell: tuple[int, int] | None) -> bool:
    """Whether a cell is the best of all near: no dearer one was left out."""
    if cell is None:
        return False
    return float(scene.terrain.cost_m[cell]) + ROUND_M <= scene.reach_m


def _cell_near(terrain: Terrain, place_m: FloatArray) -> tuple[int, int] | None:
    """The reachable cell nearest to a place, at most NEAR_M away."""
    row, col = (int(v) for v in terrain.grid.cells(place_m))
    reach = math.ceil(NEAR_M / terrain.grid.resolution_m)
    first = max(row - reach, 0), max(col - reach, 0)
    window = terrain.cost_m[
        first[0] : max(row + reach + 1, 0), first[1] : max(col + reach + 1, 0)
    ]
    cells = np.argwhere(np.isfinite(window)) + first
    if len(cells) == 0:
        return None
    away = np.hypot(*(terrain.grid.metres(cells) - place_m).T)
    nearest = int(away.argmin())
    if away[nearest] > NEAR_M:
        return None
    return int(cells[nearest, 0]), int(cells[nearest, 1])
