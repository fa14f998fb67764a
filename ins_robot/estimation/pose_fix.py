# SPDX-License-Identifier: MIT
"""A predicted pose set right by pairs of features and landmarks (the paper's section 5.1).

The similarity transform that carries the features, placed from the prediction, onto the
landmarks carries the pose as well; what the features' headings say about its turn comes on top.
Both are weighed against the prediction, and refused when they are incredible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.errors import DegenerateGeometryError
from ins_robot.estimation.correspondence import Correspondence
from ins_robot.estimation.similarity import fit_similarity
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.geometry.similarity2 import Similarity2

PAIRS_MIN = 2
SCALE_OFF_MAX, SCALE_STDS = 0.03, 4.0
FIX_STD_MIN = np.array([0.005, 0.005, math.radians(0.15)])
HEADING_VAR_MAX = math.radians(5.0) ** 2
SURPRISE_MAX = 16.3  # 99.9 % of a chi-squared of three


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFix:
    """map_from_base (3,) with its covariance (3, 3)."""

    pose: FloatArray
    covariance: FloatArray


def fix_pose(
    pairs: Correspondence, landmarks_m: FloatArray, pose: FloatArray, covariance: FloatArray
) -> PoseFix | None:
    """The prediction `pose`, `covariance` and the pairs together; None when they say nothing.

    `landmarks_m` (M, 2) are the landmarks of the M pairs.
    """
    predicted = PoseFix(pose=pose, covariance=covariance)
    placed = _by_transform(pairs, landmarks_m, predicted)
    turned = _by_headings(pairs, placed or predicted, float(pose[2]))
    return turned or placed


def _by_transform(
    pairs: Correspondence, landmarks_m: FloatArray, predicted: PoseFix
) -> PoseFix | None:
    if len(pairs) < PAIRS_MIN:
        return None
    try:
        free = fit_similarity(pairs.placed_m, landmarks_m, pairs.std_m)
        kept = free.is_inlier
        fit = fit_similarity(
            pairs.placed_m[kept], landmarks_m[kept], pairs.std_m[kept], fixed_scale=1.0
        )
    except DegenerateGeometryError:
        return None  # the odometry decides
    if abs(free.transform.scale - 1.0) > SCALE_OFF_MAX + SCALE_STDS * free.scale_std:
        return None  # both sides have the LRF's scale: another one is a wrong correspondence
    turned = Similarity2(1.0, fit.transform.turn_rad).apply(predicted.pose[:2])
    lever = np.array([[-turned[1], 1.0, 0.0], [turned[0], 0.0, 1.0], [1.0, 0.0, 0.0]])
    noise = lever @ fit.covariance[1:, 1:] @ lever.T + np.diag(FIX_STD_MIN**2)
    fixed = fit.transform.apply_to_pose(Pose2.from_array(predicted.pose)).as_array()
    return _fused(predicted, fixed - predicted.pose, np.eye(3), noise)


def _by_headings(
    pairs: Correspondence, predicted: PoseFix, heading_rad: float
) -> PoseFix | None:
    """Pairs tell the turn from `heading_rad`, from which the features were placed."""
    if not len(pairs):
        return None
    weights = 1.0 / pairs.turn_vars
    noise = 1.0 / float(weights.sum())
    if noise > HEADING_VAR_MAX:
        return None
    seen_rad = heading_rad + noise * float(weights @ pairs.turns_rad)
    H = np.array([[0.0, 0.0, 1.0]])
    return _fused(predicted, np.array([seen_rad - predicted.pose[2]]), H, np.array([[noise]]))


def _fused(
    predicted: PoseFix, off: FloatArray, H: FloatArray, noise: FloatArray
) -> PoseFix | None:
    """Kalman update by an innovation whose last element is an angle; None when incredible."""
    off[-1] = wrap_rad(float(off[-1]))
    P = predicted.covariance
    inverse = np.asarray(np.linalg.inv(H @ P @ H.T + noise), dtype=np.float64)
    if float(off @ inverse @ off) > SURPRISE_MAX:
        return None
    K = P @ H.T @ inverse
    pose = predicted.pose + K @ off
    pose[2] = wrap_rad(float(pose[2]))
    rest = np.eye(3) - K @ H
    # Joseph form: stays positive definite when a fix is far surer than the prediction
    return PoseFix(pose=pose, covariance=rest @ P @ rest.T + K @ noise @ K.T)
