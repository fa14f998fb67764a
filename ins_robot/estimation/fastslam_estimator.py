# SPDX-License-Identifier: MIT
"""The paper's section 5.2: FastSLAM on features, each particle with its own landmark map.

Particles move with the odometry (eq. 2, 3), are weighed by their features' errors in range and
bearing (eq. 4), resampled on the wheel, and averaged (eq. 5, sine over cosine). As in FastSLAM
2.0 (Montemerlo et al. 2003) the features also shape each particle's draw, without which a sure
scan after an unsure motion would leave one particle of a hundred.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from ins_robot.config import SlamConfig
from ins_robot.estimation.correspondence import correspond
from ins_robot.estimation.landmarks import GATE_CHI2, LandmarkMaps, Sightings
from ins_robot.estimation.particle_filter import ParticleFilter
from ins_robot.estimation.pose_fix import fix_pose
from ins_robot.estimation.protocol import FEATURE_REACH_M, Correction, Observation
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import between, compose
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.messages import MotionIncrement

LANDMARKS_MAX = 512
REACH_M = FEATURE_REACH_M + 2.0
AFTER_FIX = np.diag([0.03**2, 0.03**2, math.radians(1.0) ** 2])  # apart from the fix's own
SURE = np.zeros((3, 3))  # a particle knows its pose


class FastSlamEstimator:
    """Predict, find the landmarks, draw, weigh, learn, resample, average."""

    closes_loops: ClassVar[bool] = False

    def __init__(self, config: SlamConfig, rng: np.random.Generator) -> None:
        self._resample_below = config.resample_below
        self._filter = ParticleFilter(config.particles, np.zeros(3), rng)
        self._maps = LandmarkMaps(config.particles, LANDMARKS_MAX)
        self._paths: list[FloatArray] = []  # (P, 3) at each node
        self._is_resampled = False

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""
        self._filter.predict(motion)

    def correct(self, observation: Observation) -> Correction | None:
        """Weigh the particles by the features; None when none was seen before."""
        sightings = Sightings.of(observation.features)
        at, doubt = self._near_truth(sightings)
        slots = self._maps.near(self.pose(), REACH_M)
        chosen = self._maps.associate(at, sightings, slots, doubt)
        is_known = bool((chosen >= 0).any())
        if is_known:
            self._draw(at, sightings, chosen)
            self._filter.reweigh(self._log_likelihoods(sightings, chosen))
        self._maps.learn(self._filter.poses, sightings, chosen, SURE)
        drawn = self._filter.resample_below(self._resample_below)
        self._is_resampled = drawn is not None
        if drawn is not None:
            self._maps.take(drawn)
            self._paths = [poses[drawn] for poses in self._paths]
        return Correction() if is_known else None

    def keep_node(self) -> None:
        """Every particle remembers the node where it was itself."""
        self._paths.append(self._filter.poses.copy())

    def moved_nodes(self) -> FloatArray | None:
        """(K, 3) by the particles that are left: their past is the past that fits best."""
        if not self._is_resampled or not self._paths:
            return None
        paths = np.stack(self._paths, axis=1)  # (P, K, 3)
        mean = paths.mean(axis=0)
        mean[:, 2] = np.arctan2(
            np.sin(paths[..., 2]).mean(axis=0), np.cos(paths[..., 2]).mean(axis=0)
        )
        return np.asarray(mean)

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._filter.carry(new_from_old)
        self._maps.carry(new_from_old)
        self._paths = [compose(new_from_old, poses) for poses in self._paths]

    def put_down(self, pose: FloatArray) -> None:
        """Be there; the map stays."""
        self._filter.gather(pose)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._filter.mean()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._filter.covariance()

    def _near_truth(self, sightings: Sightings) -> tuple[FloatArray, FloatArray]:
        """(P, 3) poses near enough for features to be told apart, and their doubt (3, 3).

        All particles take the step that lays the features on the likeliest one's landmarks.
        """
        moved, doubt = self._filter.motion()
        best = int(np.argmax(self._filter.log_weights))
        known = self._maps.of(best, self._maps.near(moved[best], REACH_M, best))
        pairs = correspond(sightings.features, known, moved[best], doubt)
        fix = fix_pose(pairs, known.points_m[pairs.landmarks], moved[best], doubt)
        if fix is None:
            return moved, doubt
        return compose(moved, between(moved[best], fix.pose)), fix.covariance + AFTER_FIX

    def _draw(self, at: FloatArray, sightings: Sightings, chosen: IntArray) -> None:
        innovations = self._maps.innovations(at, sightings, chosen)
        weight = np.linalg.inv(innovations.covariance) * (chosen >= 0)[..., None, None]
        weighted = innovations.by_pose.swapaxes(-1, -2) @ weight  # (P, F, 3, 2)
        information = (weighted @ innovations.by_pose).sum(axis=1)
        push = (weighted @ innovations.error[..., None])[..., 0].sum(axis=1)
        turn, turn_var = self._maps.turns(at, sightings, chosen)
        turn_weight = (chosen >= 0) / turn_var
        information[:, 2, 2] += turn_weight.sum(axis=1)
        push[:, 2] += (turn_weight * turn).sum(axis=1)
        self._filter.draw(at, information, push)

    def _log_likelihoods(self, sightings: Sightings, chosen: IntArray) -> FloatArray:
        """(P,) of the features that any particle knows; one that does not is far off."""
        innovations = self._maps.innovations(self._filter.poses, sightings, chosen)
        turn, turn_var = self._maps.turns(self._filter.poses, sightings, chosen)
        chi2 = innovations.chi2() + turn**2 / turn_var
        chi2 = np.where(chosen >= 0, np.minimum(chi2, GATE_CHI2), GATE_CHI2)
        wider = np.linalg.slogdet(innovations.covariance)[1]
        wider = wider - np.linalg.slogdet(sightings.covariances)[1]
        terms = -0.5 * (chi2 + np.where(chosen >= 0, wider, 0.0))
        return np.asarray(terms[:, (chosen >= 0).any(axis=0)].sum(axis=1))
