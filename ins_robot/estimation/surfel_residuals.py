# SPDX-License-Identifier: MIT
"""A scan's surfels against those of a local map: poses in, residuals, weights, equations out.

Point-to-line along the normals of what is flat, point-to-point where the map is round, under a
Geman-McClure kernel. All poses and beams at once; what does not depend on the pose is worked
out before, once for a scan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.mapping.surfels import Surfels

MAP_STD_M = 0.015  # what a surfel of the map may be off, apart from its own noise
KERNEL_STDS = 3.0  # Geman-McClure: residuals beyond this many deviations fade
GATE_COS = 0.3  # surfaces that face apart by more do not correspond
GATE_COS_ROUND = 0.0  # nor do edges and legs seen from sides further apart
CORRELATION = 5.0  # neighbouring beams err together: this many count as one


@dataclass(frozen=True, slots=True)
class Residuals:
    """Residuals of P poses x B surfels against the nearest surfels of the map."""

    normal_m: FloatArray  # (P, B) along the map's normal
    tangent_m: FloatArray  # (P, B) across it, 0 where the map is flat
    is_round: FloatArray  # (P, B) 1 where the map's surfel is no line
    normal_x: FloatArray  # (P, B)
    normal_y: FloatArray
    lever_x_m: FloatArray  # (P, B) from the base to the point
    lever_y_m: FloatArray
    var_m2: FloatArray  # (P, B)
    is_matched: BoolArray  # (P, B)
    surfel: NDArray[np.int32]  # (P, B)


@dataclass(frozen=True, slots=True)
class FixedPart:
    """What residuals need to know of a scan's surfels (B,), wherever it is laid."""

    x: FloatArray  # (2, 1, B) of points, and of normals
    y: FloatArray
    var_m2: FloatArray  # of reading and map
    gate_flat: FloatArray  # by how much more a flat surfel of the map must face the same way
    flat_min: FloatArray  # 1: only what is flat will do, 0: what is round too

    @staticmethod
    def of(scan: Surfels) -> FixedPart:
        """Those of a scan, base frame."""
        # a wall that comes out from behind an edge is not it, and would draw the pose back
        meets_round = ~(scan.is_flat | scan.is_lone)
        return FixedPart(
            x=np.stack([scan.points_m[:, 0], scan.normals[:, 0]])[:, None],
            y=np.stack([scan.points_m[:, 1], scan.normals[:, 1]])[:, None],
            var_m2=scan.std_m**2 + MAP_STD_M**2,
            gate_flat=np.where(scan.is_flat, GATE_COS - GATE_COS_ROUND, 0.0),
            flat_min=np.where(meets_round, 0.0, 1.0),
        )


def residuals_of(field: LikelihoodField, scan: FixedPart, poses: FloatArray) -> Residuals:
    """The scan against the map, from poses (P, 3)."""
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    lever_x, turned_x = c * scan.x - s * scan.y
    lever_y, turned_y = s * scan.x + c * scan.y
    px, py = lever_x + poses[:, 0, None], lever_y + poses[:, 1, None]
    surfel = field.nearest_surfels(px, py)
    mx, my, nx, ny, var, tilt_var, flat = field.columns.take(surfel, axis=1)
    # surfaces that face apart do not correspond: the two edges of a door post are a wall apart
    is_matched = turned_x * nx + turned_y * ny > GATE_COS_ROUND + scan.gate_flat * flat
    is_matched &= (surfel >= 0) & (flat >= scan.flat_min)
    px -= mx
    py -= my
    is_round = 1.0 - flat
    tangent = py * nx - px * ny
    return Residuals(
        normal_m=px * nx + py * ny,
        tangent_m=tangent * is_round,
        is_round=is_round,
        normal_x=nx,
        normal_y=ny,
        lever_x_m=lever_x,
        lever_y_m=lever_y,
        # a tilted normal errs more the further off its surfel it is used
        var_m2=var + tilt_var * tangent**2 + scan.var_m2,
        is_matched=is_matched,
        surfel=surfel,
    )


def shares_of(residuals: Residuals, width: float) -> FloatArray:
    """(P, B) Geman-McClure: 1 for what fits, falling to 0; 0 for what has no partner."""
    square = (residuals.normal_m**2 + residuals.tangent_m**2) / residuals.var_m2
    scale = (KERNEL_STDS * width) ** 2
    return np.asarray(residuals.is_matched * scale / (scale + square))


def costs_of(shares: FloatArray) -> FloatArray:
    """(P,) with a kernel that is not widened; what has no partner costs as an outlier."""
    cost = KERNEL_STDS**2 * (1.0 - shares).sum(axis=1)
    return np.asarray(0.5 * cost / CORRELATION)


def weights_of(residuals: Residuals, shares: FloatArray) -> FloatArray:
    """(P, B) of the residuals in least squares."""
    return np.asarray(shares**2 / (residuals.var_m2 * CORRELATION))


@dataclass(frozen=True, slots=True)
class Slopes:
    """(P, 3, B) derivatives of the normal and of the tangent residual by the pose."""

    by_normal: FloatArray
    by_tangent: FloatArray

    @staticmethod
    def of(r: Residuals) -> Slopes:
        """Where the residuals were taken."""
        nx, ny = r.normal_x, r.normal_y
        count, beams = nx.shape
        by_normal, by_tangent = np.empty((2, count, 3, beams))
        by_normal[:, 0], by_normal[:, 1] = nx, ny
        by_normal[:, 2] = ny * r.lever_x_m - nx * r.lever_y_m
        by_tangent[:, 0], by_tangent[:, 1] = -ny, nx
        by_tangent[:, 2] = nx * r.lever_x_m + ny * r.lever_y_m
        return Slopes(by_normal, by_tangent)


def normal_equations(
    r: Residuals, slopes: Slopes, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Information (P, 3, 3) and gradient (P, 3)."""
    by_normal, by_tangent = slopes.by_normal, slopes.by_tangent
    weighted_n = by_normal * weights[:, None, :]
    weighted_t = by_tangent * (weights * r.is_round)[:, None, :]
    information = weighted_n @ by_normal.swapaxes(1, 2) + weighted_t @ by_tangent.swapaxes(1, 2)
    gradient = weighted_n @ r.normal_m[..., None] + weighted_t @ r.tangent_m[..., None]
    return information, gradient[..., 0]


def equations_by_source(
    sources: IntArray, r: Residuals, slopes: Slopes, weights: FloatArray, pose: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Those of one of the poses, apart by the node that each matched surfel came from.

    `sources` (N,) are the nodes of the map's surfels. Returns nodes (S,), information (S, 3, 3)
    and gradient (S, 3).
    """
    matched = np.flatnonzero(r.is_matched[pose])
    source = sources[r.surfel[pose, matched]]
    nodes = np.unique(source)
    by_normal = slopes.by_normal[pose].take(matched, axis=1)  # (3, M)
    by_tangent = slopes.by_tangent[pose].take(matched, axis=1)
    weight = weights[pose, matched]
    weighted_n = by_normal * weight
    weighted_t = by_tangent * (weight * r.is_round[pose, matched])
    outer = weighted_n[:, None] * by_normal
    outer += weighted_t[:, None] * by_tangent
    pull = weighted_n * r.normal_m[pose, matched] + weighted_t * r.tangent_m[pose, matched]
    is_from = (source == nodes[:, None]).astype(np.float64)  # (S, M)
    return nodes, np.tensordot(is_from, outer, axes=(1, 2)), is_from @ pull.T
