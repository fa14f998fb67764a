# SPDX-License-Identifier: MIT
"""Where a scan fits a local map: correlative search, then Gauss-Newton on surfels.

`search` tries every pose of a window, coarse to fine, on the maxima pyramid (Olson 2009).
`align` refines by robust point-to-line least squares and says what the scan knows: an information
matrix (3, 3) that is flat along a corridor, where the prior then decides.
Poses are map_from_base, (..., 3); the scan's surfels are in the base frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import transform_points
from ins_robot.mapping.likelihood_field import CELL_M, LEVELS, LikelihoodField
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.mapping.surfels import Surfels

SEARCH_BEAMS = 90
KEPT_PER_LEVEL = 48
RIVAL_DISTANCE_M = 0.35  # a peak this far away is another place
RIVAL_TURN_RAD = math.radians(12.0)
MAP_STD_M = 0.015  # what a surfel of the map may be off, apart from its own noise
KERNEL_STDS = 3.0  # Geman-McClure: residuals beyond this many deviations fade
KERNEL_START = 3.0  # the kernel starts this much wider and narrows
GATE_COS = 0.3  # surfaces that face apart by more do not correspond
CORRELATION = 5.0  # neighbouring beams err together: this many count as one
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
    by_source : dict of node id to (3, 3)
        The share of `information` that came from each node of the map.
    """

    pose: FloatArray
    information: FloatArray
    gradient: FloatArray
    inlier_share: float
    inliers: int
    cost: float
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
    level = LEVELS - 1
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
    turn_index, x_cells, y_cells = (
        a.reshape(-1) for a in np.meshgrid(np.arange(len(turns)), side, side, indexing="ij")
    )
    while True:
        values = _values(field, cols, rows, turn_index, x_cells, y_cells, level)
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
    field: LikelihoodField,
    cols: IntArray,
    rows: IntArray,
    turn_index: IntArray,
    x_cells: IntArray,
    y_cells: IntArray,
    level: int,
) -> FloatArray:
    """(C,) field values of the candidates."""
    return field.mean_values(
        cols[turn_index] + x_cells[:, None], rows[turn_index] + y_cells[:, None], level
    )


@dataclass(frozen=True, slots=True)
class _Residuals:
    """Point-to-line residuals of P poses x B surfels and where they came from."""

    normal_m: FloatArray  # (P, B)
    tangent_m: FloatArray  # (P, B), 0 where the map is flat
    direction: FloatArray  # (P, B, 2) normal of the map's surfel
    lever_m: FloatArray  # (P, B, 2) from the base to the point
    std_m: FloatArray  # (P, B)
    is_matched: BoolArray  # (P, B)
    surfel: IntArray  # (P, B)


def _residuals(field: LikelihoodField, scan: Surfels, poses: FloatArray) -> _Residuals:
    points = transform_points(poses, scan.points_m)
    surfel = field.nearest_surfels(points)
    is_matched = surfel >= 0
    index = np.where(is_matched, surfel, 0)
    mapped = field.surfels
    direction = mapped.normals[index]
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    nx, ny = scan.normals[:, 0], scan.normals[:, 1]
    facing = (c * nx - s * ny) * direction[..., 0] + (s * nx + c * ny) * direction[..., 1]
    both_flat = mapped.is_flat[index] & scan.is_flat
    is_matched &= (facing > GATE_COS) | ~both_flat
    offset = points - mapped.points_m[index]
    normal = (offset * direction).sum(axis=-1)
    tangent = offset[..., 1] * direction[..., 0] - offset[..., 0] * direction[..., 1]
    is_round = ~mapped.is_flat[index]
    std = np.sqrt(mapped.std_m[index] ** 2 + scan.std_m**2 + MAP_STD_M**2)
    return _Residuals(
        normal,
        np.where(is_round, tangent, 0.0),
        direction,
        points - poses[:, None, :2],
        std,
        is_matched,
        surfel,
    )


def _kernel(residuals: _Residuals, width: float) -> tuple[FloatArray, FloatArray]:
    """Geman-McClure cost (P,) and weights (P, B); what has no partner costs as an outlier."""
    square = (residuals.normal_m**2 + residuals.tangent_m**2) / residuals.std_m**2
    scale = (KERNEL_STDS * width) ** 2
    share = scale / (scale + square)
    cost = np.where(residuals.is_matched, scale * (1.0 - share), scale)
    weights = np.where(residuals.is_matched, share**2 / residuals.std_m**2, 0.0)
    return 0.5 * cost.sum(axis=1) / CORRELATION, weights / CORRELATION


def log_likelihoods(field: LikelihoodField, scan: Surfels, poses: FloatArray) -> FloatArray:
    """(P,) log-likelihood of the scan at each pose, up to a constant; all beams at once."""
    cost, _ = _kernel(_residuals(field, scan, poses), 1.0)
    return -cost


def _normal_equations(
    residuals: _Residuals, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information (P, 3, 3), gradient (P, 3), and the rows (P, 2, B, 3) they came from."""
    d, lever = residuals.direction, residuals.lever_m
    turn_n = d[..., 1] * lever[..., 0] - d[..., 0] * lever[..., 1]
    turn_t = d[..., 0] * lever[..., 0] + d[..., 1] * lever[..., 1]
    rows = np.stack(
        [
            np.stack([d[..., 0], d[..., 1], turn_n], axis=-1),
            np.stack([-d[..., 1], d[..., 0], turn_t], axis=-1),
        ],
        axis=1,
    )
    is_round = residuals.tangent_m != 0.0
    weight = np.stack([weights, np.where(is_round, weights, 0.0)], axis=1)
    error = np.stack([residuals.normal_m, residuals.tangent_m], axis=1)
    weighted = rows * weight[..., None]
    p = len(rows)
    flat_rows, flat_weighted = rows.reshape(p, -1, 3), weighted.reshape(p, -1, 3)
    information = np.swapaxes(flat_weighted, 1, 2) @ flat_rows
    gradient = (np.swapaxes(flat_weighted, 1, 2) @ error.reshape(p, -1, 1))[..., 0]
    return information, gradient, weighted


def align(
    field: LikelihoodField,
    scan: Surfels,
    starts: FloatArray,
    prior_pose: FloatArray,
    prior_information: FloatArray,
) -> Alignment:
    """Refine from each of `starts` (S, 3), keep the cheapest."""
    poses = np.array(starts, dtype=np.float64)
    for iteration in range(ITERATIONS):
        width = max(1.0, KERNEL_START * (1.0 - iteration / (ITERATIONS - 3)))
        residuals = _residuals(field, scan, poses)
        _, weights = _kernel(residuals, width)
        information, gradient, _ = _normal_equations(residuals, weights)
        off = poses - prior_pose
        off[:, 2] = wrap_rad(off[:, 2])
        step = -np.linalg.solve(
            information + prior_information, (gradient + off @ prior_information)[..., None]
        )[..., 0]
        poses = poses + step
        if width == 1.0 and np.abs(step[:, :2]).max() < CONVERGED_M:
            break
    residuals = _residuals(field, scan, poses)
    cost, weights = _kernel(residuals, 1.0)
    off = poses - prior_pose
    off[:, 2] = wrap_rad(off[:, 2])
    cost = cost + 0.5 * np.einsum("si,ij,sj->s", off, prior_information, off)
    best = int(np.argmin(cost))
    information, gradient, weighted = _normal_equations(residuals, weights)
    error = np.hypot(residuals.normal_m[best], residuals.tangent_m[best])
    is_inlier = residuals.is_matched[best] & (error < INLIER_STDS * residuals.std_m[best])
    pose = poses[best]
    pose[2] = wrap_rad(float(pose[2]))
    return Alignment(
        pose=pose,
        information=information[best],
        gradient=gradient[best],
        inlier_share=float(is_inlier.mean()),
        inliers=int(is_inlier.sum()),
        cost=float(cost[best]),
        by_source=_by_source(field, residuals, weighted, best),
    )


def _by_source(
    field: LikelihoodField, residuals: _Residuals, weighted: FloatArray, best: int
) -> dict[int, FloatArray]:
    """Information (3, 3) per node that the matched surfels came from."""
    matched = residuals.is_matched[best]
    sources = field.surfels.sources[residuals.surfel[best][matched]]
    nodes, slot = np.unique(sources, return_inverse=True)
    rows = weighted[best][
        :, matched
    ]  # (2, M, 3) weighted; unweighted rows follow from the geometry
    d, lever = residuals.direction[best][matched], residuals.lever_m[best][matched]
    plain_n = np.column_stack([d, d[:, 1] * lever[:, 0] - d[:, 0] * lever[:, 1]])
    plain_t = np.column_stack([-d[:, 1], d[:, 0], (d * lever).sum(axis=1)])
    outer = (
        rows[0][:, :, None] * plain_n[:, None, :] + rows[1][:, :, None] * plain_t[:, None, :]
    )
    sums = np.zeros((len(nodes), 3, 3))
    np.add.at(sums, slot, outer)
    return {int(node): sums[i] for i, node in enumerate(nodes)}
