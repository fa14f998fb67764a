# SPDX-License-Identifier: MIT
"""Pose estimators behind one protocol: the odometry alone, or particles on a map.

`predict` moves the pose, `correct` lays a scan on a local map if the estimator has use for it.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from ins_robot.config import SlamConfig
from ins_robot.estimation.motion_model import turned
from ins_robot.estimation.particle_filter import VARIANCE_MIN, ParticleFilter
from ins_robot.estimation.scan_matching import Alignment, align, log_likelihoods, search
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import compose
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.surfels import Surfels
from ins_robot.messages import MotionIncrement

SEARCH_STDS = 3.0
SEARCH_HALF_MIN_M = 0.1
SEARCH_HALF_MAX_M = 0.8
SEARCH_TURN_MIN_RAD = math.radians(3.0)
SEARCH_TURN_MAX_RAD = math.radians(25.0)
SURE_STD_M = 0.08  # a prior this sure needs no search, descent alone gets there
SURE_STD_RAD = math.radians(3.0)
SURE_KERNEL = 2.0
INLIER_SHARE_MIN = 0.3
INLIER_SHARE_GOOD = 0.55
INLIERS_MIN = 15
SURPRISE_MAX = 36.0  # chi-squared of match against prior beyond which the odometry decides


class Estimator(Protocol):
    """Where the base is, map_from_base (3,), and how surely (3, 3)."""

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""

    def correct(self, scan: Surfels, field: LikelihoodField) -> Alignment | None:
        """Lay a scan (base frame) on a local map; None when the pose did not use it."""

    def carry(self, new_from_old: FloatArray) -> None:
        """The map under the robot was moved."""

    def pose(self) -> FloatArray:
        """(3,)."""

    def covariance(self) -> FloatArray:
        """(3, 3), relative to the map around the robot."""


class OdometryEstimator:
    """Motion chained, nothing corrected."""

    def __init__(self) -> None:
        self._pose = np.zeros(3)
        self._covariance = VARIANCE_MIN.copy()

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""
        delta = motion.delta
        c, s = math.cos(self._pose[2]), math.sin(self._pose[2])
        lever = np.eye(3)
        lever[0, 2] = -s * delta.x_m - c * delta.y_m
        lever[1, 2] = c * delta.x_m - s * delta.y_m
        self._covariance = lever @ self._covariance @ lever.T + turned(
            motion.covariance, float(self._pose[2])
        )
        self._pose = compose(self._pose, delta.as_array())

    def correct(self, scan: Surfels, field: LikelihoodField) -> Alignment | None:
        """No scan is used."""
        return None

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._pose = compose(new_from_old, self._pose)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._pose.copy()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._covariance.copy()


class ParticleEstimator:
    """Predict, sharpen by matching, weigh, resample, average."""

    def __init__(self, config: SlamConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._filter = ParticleFilter(config.particles, np.zeros(3), rng)

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""
        self._filter.predict(motion)

    def correct(self, scan: Surfels, field: LikelihoodField) -> Alignment | None:
        """Lay a scan on a local map; None when it fits badly, and odometry decides."""
        match = _match(scan, field, *self._filter.prior())
        if match is None:
            return None
        known = scan.take(match.is_inlier)
        self._filter.weigh(match, lambda poses: log_likelihoods(field, known, poses))
        self._filter.resample_below(self._config.resample_below)
        return match

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._filter.carry(new_from_old)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._filter.mean()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._filter.covariance()


def _match(
    scan: Surfels, field: LikelihoodField, prior: FloatArray, covariance: FloatArray
) -> Alignment | None:
    """Best alignment near the prior, or None when it is poor or incredible."""
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    std_m = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    std_rad = math.sqrt(float(covariance[2, 2]))
    match = None
    if std_m < SURE_STD_M and std_rad < SURE_STD_RAD:
        match = align(field, scan, prior[None], prior, information, kernel_start=SURE_KERNEL)
    if match is None or match.inlier_share < INLIER_SHARE_GOOD:
        half_width = min(max(SEARCH_STDS * std_m, SEARCH_HALF_MIN_M), SEARCH_HALF_MAX_M)
        half_turn = min(max(SEARCH_STDS * std_rad, SEARCH_TURN_MIN_RAD), SEARCH_TURN_MAX_RAD)
        found = search(field, scan, prior, half_width, half_turn, information)
        match = align(field, scan, np.stack([found.pose, prior]), prior, information)
    if match.inliers < INLIERS_MIN or match.inlier_share < INLIER_SHARE_MIN:
        return None
    off = match.pose - prior
    off[2] = wrap_rad(float(off[2]))
    return match if float(off @ information @ off) < SURPRISE_MAX else None


def make_estimator(config: SlamConfig, rng: np.random.Generator) -> Estimator:
    """The estimator that `slam.estimator` names."""
    return (
        OdometryEstimator()
        if config.estimator == "odometry"
        else ParticleEstimator(config, rng)
    )
