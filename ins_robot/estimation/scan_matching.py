# SPDX-License-Identifier: MIT
"""Where a scan fits a local map: correlative search, then Gauss-Newton on surfels.

`search` tries every pose of a window, coarse to fine, on the maxima pyramid (Olson 2009).
`align` refines by robust point-to-line least squares and says what the scan knows: information
(3, 3) that is flat along a corridor, where the prior then decides.
Poses are map_from_base, (..., 3); the scan's surfels are in the base frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.estimation.surfel_residuals import (
    FixedPart,
    Slopes,
    costs_of,
    equations_by_source,
    normal_equations,
    residuals_of,
    shares_of,
    weights_of,
)
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import transform_points
from ins_robot.mapping.field_pyramid import FieldPyramid
from ins_robot.mapping.likelihood_field import CELL_M, LikelihoodField
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.mapping.surfels import Surfels

SEARCH_BEAMS = 90
LEVEL_MAX = 3  # the coarsest: cells 2^3 fine ones wide
KEPT_PER_LEVEL = 48
BLOCK = 500  # candidates looked up together (measured)
RIVAL_DISTANCE_M = 0.35  # a peak this far away is another place
RIVAL_TURN_RAD = math.radians(12.0)
KERNEL_START = 3.0  # the kernel starts this much wider and narrows
ITERATIONS = 8
CONVERGED_M = 2e-4
INLIER_STDS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchResult:
    """Best pose of a window, its field value in [0, 1], and the best value elsewhere in it."""

    pose: FloatArray
    value: float
    rival_value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """A scan laid on a local map.

    Attributes
    ----------
    pose : (3,)
        Best of scan and prior together.
    information : (3, 3)
        What the scan alone says around `pose`, in the map frame.
    gradient : (3,)
        Of the scan's cost at `pose`; with it the scan's own optimum is known without inverting.
    inlier_share : float
        Readings that lie on the map, of all.
    inliers : int
        Their number.
    cost : float
        Of scan and prior, smaller is better; comparable for one scan on one map.
    is_inlier : (B,) bool
        Which readings lie on the map. Whoever weighs other poses near by weighs these alone:
        what looks into the unknown must not pull the pose back to where all is known.
    by_source : dict of node id to (3, 3)
        The share of `information` that came from each node of the map.
    """

    pose: FloatArray
    information: FloatArray
    gradient: FloatArray
    inlier_share: float
    inliers: int
    cost: float
    is_inlier: BoolArray
    by_source: dict[int, FloatArray]


def search(
    field: LikelihoodField,
    scan: Surfels,
    centre: FloatArray,
    half_width_m: float,
    half_turn_rad: float,
    prior_information: FloatArray | None = None,
) -> SearchResult:
    """Best pose within +-half_width_m and +-half_turn_rad of `centre`."""
    points = scan.points_m[:: max(1, len(scan) // SEARCH_BEAMS)]
    reach_m = float(np.quantile(np.hypot(*points.T), 0.7)) + 0.5
    level = LEVEL_MAX
    while level > 0 and 2**level * CELL_M > half_width_m:
        level -= 1
    turn_step = 1.2 * CELL_M * 2.0 ** min(level, 1) / reach_m
    turns = np.arange(
        -math.ceil(half_turn_rad / turn_step), math.ceil(half_turn_rad / turn_step) + 1
    )
    headings = centre[2] + turns * turn_step
    poses = np.stack(
        [np.full(len(turns), centre[0]), np.full(len(turns), centre[1]), headings], -1
    )
    cols, rows = field.cells(transform_points(poses, points))  # (A, B)

    half = math.ceil(half_width_m / CELL_M)
    side = np.arange(-half, half + 1, 2**level)
    low = int(cols.min()) - half, int(rows.min()) - half
    beyond = half + 2**level
    high = int(cols.max()) + beyond, int(rows.max()) + beyond
    pyramid = field.pyramid(low, high, level)
    cells = pyramid.cells(cols, rows)
    turn_index, x_cells, y_cells = (
        a.reshape(-1) for a in np.meshgrid(np.arange(len(turns)), side, side, indexing="ij")
    )
    while True:
        steps = pyramid.steps(x_cells, y_cells)
        values = _values(pyramid, cells, turn_index, steps, level)
        if level == 0:
            break
        best = np.argsort(-values, kind="stable")[:KEPT_PER_LEVEL]
        level -= 1
        step = 2**level
        turn_index = np.repeat(turn_index[best], 4)
        x_cells = (x_cells[best, None] + np.array([0, step, 0, step])).reshape(-1)
        y_cells = (y_cells[best, None] + np.array([0, 0, step, step])).reshape(-1)
    found = np.stack(
        [centre[0] + x_cells * CELL_M, centre[1] + y_cells * CELL_M, headings[turn_index]], -1
    )
    score = values
    if prior_information is not None:
        error = found - centre
        score = values - 0.5 * np.einsum("ci,ij,cj->c", error, prior_information, error) / len(
            points
        )
    best_one = int(np.argmax(score))
    apart = (np.hypot(*(found[:, :2] - found[best_one, :2]).T) > RIVAL_DISTANCE_M) | (
        np.abs(found[:, 2] - found[best_one, 2]) > RIVAL_TURN_RAD
    )
    return SearchResult(
        pose=found[best_one],
        value=float(values[best_one]),
        rival_value=float(values[apart].max()) if apart.any() else 0.0,
    )


def _values(
    pyramid: FieldPyramid,
    cells: IntArray,
    turn_index: IntArray,
    steps: IntArray,
    level: int,
) -> FloatArray:
    """(C,) field values of the candidates; so many at once as a processor's cache holds."""
    values = np.empty(len(turn_index))
    for first in range(0, len(turn_index), BLOCK):
        part = slice(first, first + BLOCK)
        moved = cells.take(turn_index[part], axis=0) + steps[part, None]
        values[part] = pyramid.mean_values(moved, level)
    return values


def log_likelihoods(field: LikelihoodField, scan: Surfels, poses: FloatArray) -> FloatArray:
    """(P,) log-likelihood of the scan at each pose, up to a constant; all beams at once.

    What finds nothing costs as an outlier: to be weighed are readings known to lie on the map.
    """
    return -costs_of(shares_of(residuals_of(field, FixedPart.of(scan), poses), 1.0))


def align(
    field: LikelihoodField,
    scan: Surfels,
    starts: FloatArray,
    prior_pose: FloatArray,
    prior_information: FloatArray,
    kernel_start: float = KERNEL_START,
) -> Alignment:
    """Refine from each of `starts` (S, 3), keep the cheapest.

    `kernel_start` is how much wider the robust kernel is at first: 1 for starts that are close.
    """
    poses, fixed = np.array(starts, dtype=np.float64), FixedPart.of(scan)
    for iteration in range(ITERATIONS):
        width = max(1.0, kernel_start * (1.0 - iteration / (ITERATIONS - 3)))
        residuals = residuals_of(field, fixed, poses)
        weights = weights_of(residuals, shares_of(residuals, width))
        information, gradient = normal_equations(residuals, Slopes.of(residuals), weights)
        off = poses - prior_pose
        off[:, 2] = wrap_rad(off[:, 2])
        step = -np.linalg.solve(
            information + prior_information, (gradient + off @ prior_information)[..., None]
        )[..., 0]
        poses = poses + step
        if width == 1.0 and np.abs(step[:, :2]).max() < CONVERGED_M:
            break
    residuals = residuals_of(field, fixed, poses)
    shares, slopes = shares_of(residuals, 1.0), Slopes.of(residuals)
    weights = weights_of(residuals, shares)
    off = poses - prior_pose
    off[:, 2] = wrap_rad(off[:, 2])
    cost = costs_of(shares) + 0.5 * np.einsum("si,ij,sj->s", off, prior_information, off)
    best = int(np.argmin(cost))
    information, gradient = normal_equations(residuals, slopes, weights)
    error = np.hypot(residuals.normal_m[best], residuals.tangent_m[best])
    is_inlier = residuals.is_matched[best] & (
        error < INLIER_STDS * np.sqrt(residuals.var_m2[best])
    )
    nodes, shares_by_node, _ = equations_by_source(
        field.surfels.sources, residuals, slopes, weights, best
    )
    pose = poses[best]
    pose[2] = wrap_rad(float(pose[2]))
    return Alignment(
        pose=pose,
        information=information[best],
        gradient=gradient[best],
        inlier_share=float(is_inlier.mean()),
        inliers=int(is_inlier.sum()),
        cost=float(cost[best]),
        is_inlier=is_inlier,
        by_source=dict(zip(nodes.tolist(), shares_by_node, strict=True)),
    )
