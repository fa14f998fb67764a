# SPDX-License-Identifier: MIT
"""How good a run really was, told from what only the simulator knows.

In: the finished run's map and trajectory, the true poses, what the beams covered. Out: the
metrics of summary.json. Map and world differ by the start pose alone: nothing is aligned.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ins_robot.config import Config
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.mapping.map_files import GridView
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

NEAREST_FACES = 8  # by their middles; the nearest of all is among them but for a hair


def metrics(
    config: Config,
    body: RobotBody,
    optics: WorldOptics,
    grid: GridView,
    map_from_base: FloatArray,
    true_map_from_base: FloatArray,
) -> dict[str, float]:
    """The truth's part of summary.json; NaN for what does not exist (no map, no way).

    Parameters
    ----------
    grid : GridView
        The run's map.
    map_from_base, true_map_from_base : (N, 3) float64
        Estimated and true poses at the same stamps, map frame.
    """
    world, start = body.world, body.start
    visible = visible_cells(world, start, config.robot.radius_m, config.lrf.range_max_m)
    found: dict[str, float] = {
        "coverage": round(coverage(optics.seen.is_seen(), visible), 4),
        "collisions": body.collisions,
        "true_path_length_m": round(body.path_length_m, 3),
        "wall_error_m": math.nan,
        "localization_rmse_m": math.nan,
        "heading_rmse_deg": math.nan,
        "true_home_m": math.nan,
    }
    if grid.is_occupied.any():
        found["wall_error_m"] = round(wall_error_m(world, start, grid), 4)
    if len(map_from_base):
        position, heading = pose_errors(map_from_base, true_map_from_base)
        found["localization_rmse_m"] = round(_rms(position), 4)
        found["localization_max_m"] = round(float(position.max()), 4)
        end = true_map_from_base[-1]
        found["true_home_m"] = round(float(np.hypot(end[0], end[1])), 3)
        found["heading_rmse_deg"] = round(float(np.degrees(_rms(heading))), 4)
    return found


def in_map_frame(world_from_base: FloatArray, start: Pose2) -> FloatArray:
    """(N, 3) map_from_base: the map frame's origin and x axis are at the start pose."""
    return between(start.as_array(), world_from_base)


def coverage(is_seen: NDArray[np.bool_], is_visible: NDArray[np.bool_]) -> float:
    """Share of the visible cells (H, W) that were seen."""
    return float((is_seen & is_visible).sum() / max(1, is_visible.sum()))


def wall_error_m(world: World, start: Pose2, grid: GridView) -> float:
    """Mean distance from each occupied map cell's centre to the nearest face of a true wall.

    Faces, where walls end and free ground begins, are what an LRF measures; a cell deep inside
    a wall is an error too. A perfect map scores up to half a cell, by how its grid lies to the
    world's: half where they coincide, nothing where they are half a cell apart.
    """
    cells = np.argwhere(grid.is_occupied)[:, ::-1] + 0.5
    points = start.apply(cells * grid.resolution_m + np.asarray(grid.origin_m))
    middles, half_m = _faces(world)
    _, nearest = cKDTree(middles).query(
        points, k=np.arange(min(NEAREST_FACES, len(middles))) + 1
    )
    beyond = np.abs(points[:, None] - middles[nearest]) - half_m[nearest]
    return float(np.hypot(*np.maximum(beyond, 0.0).transpose(2, 0, 1)).min(axis=1).mean())


def _faces(world: World) -> tuple[FloatArray, FloatArray]:
    """(F, 2) middles of the sides between a wall's and a free cell; (F, 2) half their size."""
    walls, half_m = world.is_occupied, 0.5 * world.resolution_m
    upright = np.argwhere(walls[:, 1:] != walls[:, :-1]) + np.array([0.5, 1.0])
    level = np.argwhere(walls[1:] != walls[:-1]) + np.array([1.0, 0.5])
    middles = world.metres(np.concatenate([upright, level]))
    sizes = np.repeat([(0.0, half_m), (half_m, 0.0)], [len(upright), len(level)], axis=0)
    return middles, sizes


def pose_errors(estimated: FloatArray, true: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) distances in metres and (N,) heading differences in radians, of poses (N, 3)."""
    offset = estimated - true
    return np.hypot(offset[:, 0], offset[:, 1]), np.abs(wrap_rad(offset[:, 2]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
