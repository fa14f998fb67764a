# SPDX-License-Identifier: MIT
"""Where a scan taken somewhere near a named place fits the map, or that it fits nowhere.

For an LRF that is carried: there is no odometry, only the word of a person, decimetres and tens
of degrees wide. In go the scan, the map and that prior; out comes a prior as narrow as the scan
makes it. Nothing is changed here, so a scan that is refused leaves no trace.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.estimation.scan_matching import Alignment, align, search
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import transform_points
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.surfels import Surfels

SEARCH_STDS = 3.0
TURN_STEP_RAD = math.radians(15.0)  # one search covers this much to each side
INLIERS_MIN = 30
INLIER_SHARE_MIN = 0.3
IN_THE_OPEN_M = 0.2  # a reading that ends in free space this far from all walls denies the map
DENIED_SHARE_MAX = 0.15
MATCH_WORTH = 0.04  # the scan is used once more for the pose itself: here it only narrows


def place(
    field: LikelihoodField,
    grid: OccupancyGrid,
    scan: Surfels,
    prior: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Pose (3,) and its covariance (3, 3), map frame; None when the scan fits nowhere near.

    Parameters
    ----------
    scan : Surfels
        Base frame.
    prior, covariance : (3,), (3, 3)
        Where it is said to have been taken, and how surely.
    """
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    half_width_m = SEARCH_STDS * math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    half_turn_rad = SEARCH_STDS * math.sqrt(float(covariance[2, 2]))
    windows = max(1, math.ceil(half_turn_rad / TURN_STEP_RAD))
    half_turn_rad /= windows
    starts = [prior]
    for window in range(windows):  # narrow windows: a wide one prunes the right heading away
        centre = prior.copy()
        centre[2] += (2 * window - windows + 1) * half_turn_rad
        starts.append(search(field, scan, centre, half_width_m, half_turn_rad).pose)
    match = align(field, scan, np.stack(starts), prior, information)
    if not _fits(match, grid, scan):
        return None
    narrowed = np.linalg.inv(information + MATCH_WORTH * match.information)
    return match.pose, np.asarray(narrowed, dtype=np.float64)


def _fits(match: Alignment, grid: OccupancyGrid, scan: Surfels) -> bool:
    """Whether enough readings lie on the map's walls, and few in its open space."""
    if match.inliers < INLIERS_MIN or match.inlier_share < INLIER_SHARE_MIN:
        return False
    return denied_share(grid, transform_points(match.pose, scan.points_m)) <= DENIED_SHARE_MAX


def denied_share(grid: OccupancyGrid, points_m: FloatArray) -> float:
    """Share of the points (N, 2), map frame, that lie where the map saw nothing but air."""
    cells = grid.cells(points_m)
    cells = cells[grid.contains(cells)]
    rows, cols = cells[:, 0], cells[:, 1]
    is_open = grid.is_free[rows, cols] & (grid.distance_m()[rows, cols] > IN_THE_OPEN_M)
    return float(is_open.sum()) / max(1, len(points_m))
