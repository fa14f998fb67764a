# SPDX-License-Identifier: MIT
"""The estimators that `slam.estimator` names; each is a small class behind one protocol."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ins_robot.config import SlamConfig
from ins_robot.estimation.fastslam_estimator import FastSlamEstimator
from ins_robot.estimation.odometry_estimator import OdometryEstimator
from ins_robot.estimation.particle_estimator import ParticleEstimator
from ins_robot.estimation.protocol import Estimator
from ins_robot.estimation.similarity_estimator import SimilarityEstimator

ESTIMATORS: dict[str, Callable[[SlamConfig, np.random.Generator], Estimator]] = {
    "odometry": lambda config, rng: OdometryEstimator(),
    "similarity": lambda config, rng: SimilarityEstimator(),
    "fastslam": FastSlamEstimator,
    "particle": ParticleEstimator,
    "auto": ParticleEstimator,  # the best of them, see docs/results.md
}


def make_estimator(config: SlamConfig, rng: np.random.Generator) -> Estimator:
    """The estimator that `slam.estimator` names."""
    return ESTIMATORS[config.estimator](config, rng)
