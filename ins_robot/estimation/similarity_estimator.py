# SPDX-License-Identifier: MIT
"""The paper's section 5.1: features against objects placed before give a similarity transform.

The transform that carries the features, placed by odometry, onto the objects corrects the pose;
the features are then placed again from there and become objects. A scan has the LRF's scale,
and so has the map: a transform that needs another one is a wrong correspondence. What lambda
says about the wheels shows over a way, see `ins_robot.estimation.wheel_scale`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ins_robot.errors import DegenerateGeometryError
from ins_robot.estimation.correspondence import Correspondence, correspond
from ins_robot.estimation.landmarks import LandmarkMaps, Sightings
from ins_robot.estimation.motion_model import REPEATED_ERRORS
from ins_robot.estimation.odometry_estimator import OdometryEstimator
from ins_robot.estimation.protocol import FEATURE_REACH_M, Correction, Observation
from ins_robot.estimation.similarity import fit_similarity
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.geometry.similarity2 import Similarity2
from ins_robot.messages import MotionIncrement

OBJECTS_MAX = 1024
REACH_M = FEATURE_REACH_M + 2.0
PAIRS_MIN = 2
SCALE_OFF_MAX, SCALE_STDS = 0.03, 4.0
FIX_STD_MIN = np.array([0.005, 0.005, math.radians(0.15)])
HEADING_VAR_MAX = math.radians(5.0) ** 2
SURPRISE_MAX = 16.3  # 99.9 % of a chi-squared of three


class SimilarityEstimator:
    """Odometry, set right by similarity transforms."""

    closes_loops: ClassVar[bool] = False

    def __init__(self) -> None:
        self._odometry = OdometryEstimator()
        self._doubtful = OdometryEstimator()  # the same, its motions worth less
        self._objects = LandmarkMaps(1, OBJECTS_MAX)

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""
        self._odometry.predict(motion)
        worth_less = replace(motion, covariance=motion.covariance * REPEATED_ERRORS)
        self._doubtful.predict(worth_less)

    def correct(self, observation: Observation) -> Correction | None:
        """Lay the features on the objects; None when they do not tell where."""
        sightings = Sightings.of(observation.features)
        pose, covariance = self.pose(), self._doubtful.covariance()
        slots = self._objects.near(pose, REACH_M)
        known = self._objects.of(0, slots)
        pairs = correspond(sightings.features, known, pose, covariance)
        fix = _fix(pairs, known.points_m[pairs.landmarks], pose)
        is_fixed = fix is not None and self._fuse(*fix, pose, covariance)
        is_fixed |= self._turn(pairs, pose)
        here = self.pose()[None]
        chosen = self._objects.associate(here, sightings, slots, self.covariance())
        self._objects.learn(here, sightings, chosen, self.covariance())
        return Correction() if is_fixed else None

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._odometry.carry(new_from_old)
        self._doubtful.carry(new_from_old)
        self._objects.carry(new_from_old)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._odometry.pose()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._odometry.covariance()

    def _fuse(
        self, fix: FloatArray, noise: FloatArray, pose: FloatArray, covariance: FloatArray
    ) -> bool:
        """Weigh the fix against the odometry; False when it is incredible."""
        off = fix - pose
        off[2] = wrap_rad(float(off[2]))
        total = np.asarray(np.linalg.inv(covariance + noise), dtype=np.float64)
        if float(off @ total @ off) > SURPRISE_MAX:
            return False
        K = covariance @ total
        better = pose + K @ off
        better[2] = wrap_rad(float(better[2]))
        self._odometry.set(better, K @ noise)  # (I - K) P = K R
        self._doubtful.set(better, K @ noise)
        return True


    def _turn(self, pairs: Correspondence, predicted: FloatArray) -> bool:
        """Set the heading right by that of the features; False when there is none."""
        if not len(pairs):
            return False
        weights = 1.0 / pairs.turn_vars
        noise = 1.0 / float(weights.sum())
        turn = noise * float(weights @ pairs.turns_rad)
        pose, covariance = self.pose(), self._doubtful.covariance()
        off = wrap_rad(predicted[2] + turn - pose[2])
        total = float(covariance[2, 2]) + noise
        if noise > HEADING_VAR_MAX or off**2 > SURPRISE_MAX * total:
            return False
        K = covariance[:, 2] / total
        better = pose + K * off
        better[2] = wrap_rad(float(better[2]))
        smaller = covariance - np.outer(K, covariance[2])
        self._odometry.set(better, smaller)
        self._doubtful.set(better, smaller)
        return True


def _fix(
    pairs: Correspondence, objects_m: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Pose (3,) and covariance (3, 3) by the transform alone."""
    if len(pairs) < PAIRS_MIN:
        return None
    try:
        free = fit_similarity(pairs.placed_m, objects_m, pairs.std_m)
        kept = free.is_inlier
        fit = fit_similarity(
            pairs.placed_m[kept], objects_m[kept], pairs.std_m[kept], fixed_scale=1.0
        )
    except DegenerateGeometryError:
        return None  # the odometry decides
    if abs(free.transform.scale - 1.0) > SCALE_OFF_MAX + SCALE_STDS * free.scale_std:
        return None
    fixed = fit.transform.apply_to_pose(Pose2.from_array(pose)).as_array()
    turned = Similarity2(1.0, fit.transform.turn_rad).apply(pose[:2])
    lever = np.array([[-turned[1], 1.0, 0.0], [turned[0], 0.0, 1.0], [1.0, 0.0, 0.0]])
    noise = lever @ fit.covariance[1:, 1:] @ lever.T
    return fixed, noise + np.diag(FIX_STD_MIN**2)
