# SPDX-License-Identifier: MIT
"""A scan laid on a finished map from many poses at once: refined, and judged.

`everywhere` tries every place and heading (correlative search, Olson 2009); `refine` is robust
Gauss-Newton on the distances to the walls; `judge` is the likelihood-field model (Thrun,
Burgard, Fox 2005, section 6.4) with one thing that model lacks: a beam that would have had to
pass a wall to end where it did has failed, however well its end fits.
Poses are map_from_base, (P, 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, compose, transform_points
from ins_robot.mapping.distance_map import DistanceMap
from ins_robot.mapping.map_files import BoolArray
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.messages import LaserScan

BEAMS_MAX = 72
BEAM_SPACING_M = 0.1  # readings closer together say the same
BEAM_REACH_M = 10.0
MAP_STD_M = 0.06  # of a wall's place: cell size, furniture moved a little, the pose itself
WRONG_SHARE = 0.05  # likelihood of a reading where the map has nothing, against one on a wall
CORRELATION = 4.0  # neighbouring beams err together: this many count as one
PASSED_M = 0.25  # a beam that ends this far behind a wall has passed it
INLIER_STDS = 2.5

SEARCH_BEAMS = 40
SEARCH_STEP_M = 0.2
SEARCH_TURN_RAD = math.radians(3.0)
SEARCH_STD_M = 0.2
SEARCH_BLOCK = 20_000  # places scored at once, to bound memory

ITERATIONS = 10
KERNEL_STDS = 3.0
KERNEL_START = 3.0
CONVERGED_M = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Beams:
    """The B readings of a scan that are used, in the LRF's and in the base frame.

    Attributes
    ----------
    bearings_rad, ranges_m : (B,)
        LRF frame.
    points_m : (B, 2)
        Base frame.
    std_m : (B,)
        Of reading and map together.
    """

    base_from_lrf: Pose2
    bearings_rad: FloatArray
    ranges_m: FloatArray
    points_m: FloatArray
    std_m: FloatArray

    def __len__(self) -> int:
        return len(self.ranges_m)

    @staticmethod
    def of(scan: LaserScan, base_from_lrf: Pose2) -> Beams:
        """Readings apart from one another, evenly chosen."""
        used = np.flatnonzero(np.nan_to_num(scan.ranges_m, nan=np.inf) <= BEAM_REACH_M)
        ranges, bearings = scan.ranges_m[used], scan.bearings_rad[used]
        points = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
        cells = np.floor(points / BEAM_SPACING_M).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        kept = np.sort(first)
        if len(kept) > BEAMS_MAX:
            kept = kept[np.linspace(0, len(kept) - 1, BEAMS_MAX).astype(np.int64)]
        return Beams(
            base_from_lrf=base_from_lrf,
            bearings_rad=bearings[kept],
            ranges_m=ranges[kept],
            points_m=base_from_lrf.apply(points[kept]),
            std_m=np.hypot(scan.range_std_m[used][kept], MAP_STD_M),
        )


def everywhere(field: DistanceMap, beams: Beams, count_max: int) -> FloatArray:
    """(P, 3) places on a lattice over the free cells where the scan fits best, best first.

    Only local maxima among places and headings, `count_max` of them at most.
    """
    points = beams.points_m[:: max(1, len(beams) // SEARCH_BEAMS)]
    step = max(1, round(SEARCH_STEP_M / field.resolution_m))
    height, width = (side // step for side in field.is_free.shape)
    blocks = field.is_free[: height * step, : width * step].reshape(height, step, width, step)
    places = np.flatnonzero(blocks.any(axis=(1, 3)))
    corner = np.stack(np.divmod(places, width), axis=-1) * step + 0.5 * step
    at = field.metres(corner)
    headings = np.arange(-math.pi, math.pi - 1e-9, SEARCH_TURN_RAD)
    values = np.exp(-0.5 * (field.signed_m / SEARCH_STD_M) ** 2).reshape(-1)
    scores = np.full((len(headings), height * width), -1.0, np.float32)
    rows, cols = field.signed_m.shape
    for k, heading in enumerate(headings):  # a heading at a time, to bound memory
        turned = transform_points(np.array([0.0, 0.0, heading]), points) / field.resolution_m
        for first in range(0, len(places), SEARCH_BLOCK):
            block = slice(first, first + SEARCH_BLOCK)
            row = (corner[block, 0, None] + turned[:, 1]).astype(np.int32)
            col = (corner[block, 1, None] + turned[:, 0]).astype(np.int32)
            np.clip(row, 0, rows - 1, out=row)
            np.clip(col, 0, cols - 1, out=col)
            row *= cols
            row += col
            scores[k, places[block]] = values.take(row).mean(axis=1)
    volume = scores.reshape(len(headings), height, width)
    is_peak = volume >= maximum_filter(volume, size=3, mode=("wrap", "nearest", "nearest"))
    turn, place = np.nonzero((is_peak & (volume > 0.0)).reshape(len(headings), -1))
    best = np.argsort(-scores[turn, place], kind="stable")[:count_max]
    chosen = at[np.searchsorted(places, place[best])]
    return np.column_stack([chosen, headings[turn[best]]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """Poses (P, 3) at the optimum of scan and prior, the scan's information (P, 3, 3) there."""

    poses: FloatArray
    information: FloatArray


def refine(
    field: DistanceMap, beams: Beams, starts: FloatArray, prior_information: FloatArray
) -> Refined:
    """Descend from `starts`, held back there by `prior_information` (3,), a diagonal."""
    poses = np.array(starts)
    prior = np.diag(prior_information)
    for iteration in range(ITERATIONS):
        width = max(1.0, KERNEL_START * (1.0 - iteration / (ITERATIONS - 3)))
        information, gradient = _normal_equations(field, beams, poses, width)
        off = _difference(poses, starts)
        step = -np.linalg.solve(information + prior, (gradient + off @ prior)[..., None])[
            ..., 0
        ]
        poses = poses + step
        if width == 1.0 and np.abs(step[:, :2]).max(initial=0.0) < CONVERGED_M:
            break
    poses[:, 2] = wrap_rad(poses[:, 2])
    information, _ = _normal_equations(field, beams, poses, 1.0)
    return Refined(poses=poses, information=information)


def _normal_equations(
    field: DistanceMap, beams: Beams, poses: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Information (P, 3, 3) and gradient (P, 3) under a Geman-McClure kernel."""
    points = transform_points(poses, beams.points_m)
    distance, by_x, by_y = field.with_slope(points)
    lever = points - poses[:, None, :2]
    by_turn = by_y * lever[..., 0] - by_x * lever[..., 1]
    scale = (KERNEL_STDS * width * beams.std_m) ** 2
    weight = (scale / (scale + distance**2)) ** 2 / (beams.std_m**2 * CORRELATION)
    jacobian = np.stack([by_x, by_y, by_turn], axis=1)  # (P, 3, B)
    weighted = jacobian * weight[:, None, :]
    information = weighted @ jacobian.swapaxes(1, 2)
    gradient = (weighted @ distance[..., None])[..., 0]
    return information + np.eye(3) * 1e-9, gradient


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Log-likelihood (P,) of the scan, and share (P,) of its readings that fit."""

    log_likelihoods: FloatArray
    fit_shares: FloatArray


def judge(field: DistanceMap, beams: Beams, poses: FloatArray) -> Judgement:
    """How well the scan fits at each pose as it stands."""
    distance, _, _ = field.with_slope(transform_points(poses, beams.points_m))
    is_passed = _passes_walls(field, beams, poses)
    stds = np.where(is_passed, np.inf, np.abs(distance) / beams.std_m)
    likelihood = WRONG_SHARE + (1.0 - WRONG_SHARE) * np.exp(-0.5 * stds**2)
    return Judgement(
        log_likelihoods=np.log(likelihood).sum(axis=1) / CORRELATION,
        fit_shares=(stds < INLIER_STDS).mean(axis=1) if len(beams) else np.zeros(len(poses)),
    )


def _passes_walls(field: DistanceMap, beams: Beams, poses: FloatArray) -> BoolArray:
    """(P, B) whether a beam would have had to pass a wall."""
    map_from_lrf = compose(poses, beams.base_from_lrf.as_array())
    bearings = (map_from_lrf[:, 2, None] + beams.bearings_rad).reshape(-1)
    starts = np.repeat(field.cells(map_from_lrf[:, :2]), len(beams), axis=0)
    limit = float(beams.ranges_m.max(initial=0.0)) / field.resolution_m
    free_m = cast_rays(field.is_occupied, starts, bearings, limit) * field.resolution_m
    passed_m = beams.ranges_m - free_m.reshape(len(poses), -1)
    return np.asarray(passed_m > PASSED_M + INLIER_STDS * beams.std_m)


def _difference(poses: FloatArray, from_poses: FloatArray) -> FloatArray:
    """(P, 3) poses - from_poses, headings wrapped."""
    off = poses - from_poses
    off[:, 2] = wrap_rad(off[:, 2])
    return off
