# SPDX-License-Identifier: MIT
"""Particle filter over poses: knows motion and a likelihood function, knows no map.

Prediction samples the motion (the paper's eq. 2-3); a scan that could be matched sharpens the
proposal, particle by particle (FastSLAM 2.0: Montemerlo et al. 2003; Grisetti et al. 2007), and
the true likelihood corrects the weights. The match enters as information and gradient, so
that a corridor, which says nothing along its axis, leaves the motion to decide there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ins_robot.estimation.motion_model import sample_motion, turned
from ins_robot.estimation.resampling import (
    effective_sample_size,
    normalise,
    resample_low_variance,
)
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.angles import FloatArray, circular_mean_rad, wrap_rad
from ins_robot.geometry.pose2 import compose
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.messages import MotionIncrement

LogLikelihood = Callable[[FloatArray], FloatArray]
VARIANCE_MIN = np.diag([1e-8, 1e-8, 1e-9])


class Cloud:
    """P weighted poses; what they say together is worked out once, when first asked for.

    Attributes
    ----------
    poses : (P, 3)
        x_m, y_m, heading_rad.
    log_weights : (P,)
        Up to a common constant.
    """

    def __init__(self, poses: FloatArray, log_weights: FloatArray) -> None:
        self.poses, self.log_weights = poses, log_weights

    @cached_property
    def weights(self) -> FloatArray:
        """(P,) that sum to 1."""
        return normalise(self.log_weights)

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """(3,) mean position and circular mean heading; (3, 3) covariance."""
        return _moments(self.poses, self.weights)


class ParticleFilter:
    """A cloud of poses that moves, is weighed and drawn anew."""

    def __init__(self, count: int, pose: FloatArray, rng: np.random.Generator) -> None:
        self._cloud = Cloud(np.tile(pose, (count, 1)), np.zeros(count))
        self._moved = self.poses
        self._motion_covariance = VARIANCE_MIN
        self._repeated = 1.0
        self._rng = rng

    @property
    def poses(self) -> FloatArray:
        """(P, 3)."""
        return self._cloud.poses

    @property
    def log_weights(self) -> FloatArray:
        """(P,) up to a common constant."""
        return self._cloud.log_weights

    def predict(self, motion: MotionIncrement) -> None:
        """Move every particle by its own draw of the motion."""
        heading_rad = self.mean()[2]
        self._repeated = motion.repeated
        self._moved = compose(self.poses, motion.delta.as_array())
        self._motion_covariance = turned(motion.covariance, heading_rad) + VARIANCE_MIN
        self._cloud = Cloud(sample_motion(self.poses, motion, self._rng), self.log_weights)

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean (3,) and covariance (3, 3) of the prediction, without its sampling noise."""
        mean, covariance = _moments(self._moved, self._cloud.weights)
        return mean, covariance + self._motion_covariance * self._repeated

    def doubt(self, covariance: FloatArray) -> None:
        """The last motion may be off by so much more, (3, 3)."""
        self._motion_covariance = self._motion_covariance + covariance

    def weigh(self, match: Alignment, log_likelihood: LogLikelihood) -> None:
        """Draw each particle from motion times match instead; weigh it by the scan itself."""
        motion_information = np.linalg.inv(self._motion_covariance * self._repeated)
        information = motion_information + match.information
        covariance = np.linalg.inv(information)
        ahead = _difference(self._moved, match.pose)  # each particle's motion mean
        mean = (ahead @ motion_information - match.gradient) @ covariance
        root = np.linalg.cholesky(0.5 * (covariance + covariance.T))
        noise = _balanced_noise(len(mean), self._rng)
        drawn = mean + noise @ root.T
        poses = _wrapped(match.pose + drawn)
        # weight = likelihood * motion / proposal, each up to a common constant
        moved = drawn - ahead
        log_motion = -0.5 * np.einsum("pi,ij,pj->p", moved, motion_information, moved)
        log_proposal = -0.5 * np.sum(noise**2, axis=1)
        log_weights = self.log_weights + log_likelihood(poses) + log_motion - log_proposal
        self._cloud = Cloud(poses, log_weights - log_weights.max())

    def motion(self) -> tuple[FloatArray, FloatArray]:
        """(P, 3) where the motion leads each particle without noise; its covariance (3, 3)."""
        return self._moved, self._motion_covariance * self._repeated

    def draw(self, at: FloatArray, information: FloatArray, push: FloatArray) -> None:
        """Draw each particle from its motion times what it measured, and weigh the difference.

        Around `at` (P, 3) a particle's measurements have `information` (P, 3, 3) and pull by
        `push` (P, 3), the negative gradient. Their likelihood is for the caller to add.
        """
        moved, motion_covariance = self.motion()
        motion_information = np.linalg.inv(motion_covariance)
        total = information + motion_information
        covariance = np.linalg.inv(total)
        ahead = _difference(moved, at)
        mean = (covariance @ (ahead @ motion_information + push)[..., None])[..., 0]
        root = np.linalg.cholesky(0.5 * (covariance + covariance.swapaxes(1, 2)))
        noise = _balanced_noise(len(at), self._rng)
        drawn = mean + (root @ noise[..., None])[..., 0]
        # weight = motion / proposal, each up to a common constant
        off = drawn - ahead
        log_motion = -0.5 * np.einsum("pi,ij,pj->p", off, motion_information, off)
        log_proposal = 0.5 * np.linalg.slogdet(total)[1] - 0.5 * np.sum(noise**2, axis=1)
        log_weights = self.log_weights + log_motion - log_proposal
        self._cloud = Cloud(_wrapped(at + drawn), log_weights)

    def reweigh(self, log_likelihoods: FloatArray) -> None:
        """Multiply the weights by likelihoods (P,)."""
        log_weights = self.log_weights + log_likelihoods
        self._cloud = Cloud(self.poses, log_weights - log_weights.max())

    def resample_below(self, share: float) -> IntArray | None:
        """Resample when the effective sample size falls below that share.

        Returns whom each particle (P,) descends from; None when nothing was drawn.
        """
        weights = self._cloud.weights
        if effective_sample_size(weights) >= share * len(weights):
            return None
        drawn = resample_low_variance(weights, self._rng)
        self._cloud = Cloud(self.poses[drawn], np.zeros(len(weights)))
        return drawn

    def carry(self, new_from_old: FloatArray) -> None:
        """Move the whole cloud by a correction of the map under it."""
        self._cloud = Cloud(compose(new_from_old, self.poses), self.log_weights)

    def gather(self, pose: FloatArray) -> None:
        """All particles at one pose (3,), none likelier than another."""
        count = len(self.poses)
        self._cloud = Cloud(np.tile(pose, (count, 1)), np.zeros(count))

    def mean(self) -> FloatArray:
        """(3,) mean position and circular mean heading (the paper's estimate)."""
        return self._cloud.moments[0].copy()

    def covariance(self) -> FloatArray:
        """(3, 3) of the cloud."""
        return self._cloud.moments[1] + VARIANCE_MIN


def _balanced_noise(count: int, rng: np.random.Generator) -> FloatArray:
    """(P, 3) standard normal draws in pairs of opposite sign: their mean adds no noise."""
    half = rng.standard_normal(((count + 1) // 2, 3))
    return np.concatenate([half, -half])[:count]


def _wrapped(poses: FloatArray) -> FloatArray:
    poses[..., 2] = wrap_rad(poses[..., 2])
    return poses


def _difference(poses: FloatArray, pose: FloatArray) -> FloatArray:
    return _wrapped(poses - pose)


def _moments(poses: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ poses
    mean[2] = circular_mean_rad(poses[:, 2], weights)
    off = _difference(poses, mean)
    return mean, (off * weights[:, None]).T @ off
