# SPDX-License-Identifier: MIT
"""How good a run really was, told from what only the simulator knows.

In: the finished run's map and trajectory, the true poses, what the beams covered. Out: the
metrics of summary.json. Map and world differ by the start pose alone: nothing is aligned.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ins_robot.config import Config
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.mapping.map_files import GridView
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World


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
    """Mean distance from each occupied map cell to the nearest cell of a true wall's surface.

    Centre to centre, so that a perfect map scores a fraction of a cell and not 0. Only wall
    cells that touch a free cell are surface: a map cell deep inside a wall is an error too.
    """
    surface = world.is_occupied & ndimage.binary_dilation(
        ~world.is_occupied, structure=np.ones((3, 3), dtype=bool)
    )
    true_points = world.metres(np.argwhere(surface) + 0.5)
    cells = np.argwhere(grid.is_occupied)[:, ::-1] + 0.5
    map_points = cells * grid.resolution_m + np.asarray(grid.origin_m)
    distance, _ = cKDTree(true_points).query(start.apply(map_points))
    return float(distance.mean())


def pose_errors(estimated: FloatArray, true: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) distances in metres and (N,) heading differences in radians, of poses (N, 3)."""
    offset = estimated - true
    return np.hypot(offset[:, 0], offset[:, 1]), np.abs(wrap_rad(offset[:, 2]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
