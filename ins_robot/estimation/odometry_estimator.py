# SPDX-License-Identifier: MIT
"""Motion chained, nothing corrected: what the other estimators have to beat."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from ins_robot.estimation.motion_model import turned
from ins_robot.estimation.particle_filter import VARIANCE_MIN
from ins_robot.estimation.protocol import Correction, Observation
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import compose
from ins_robot.messages import MotionIncrement


class OdometryEstimator:
    """Dead reckoning."""

    closes_loops: ClassVar[bool] = False

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

    def correct(self, observation: Observation) -> Correction | None:
        """No scan is used."""
        return None

    def set(self, pose: FloatArray, covariance: FloatArray) -> None:
        """Go on from here: somebody knew better."""
        self._pose, self._covariance = pose.copy(), covariance.copy()

    def keep_node(self) -> None:
        """Nodes are left to the map."""

    def moved_nodes(self) -> FloatArray | None:
        """Nodes are left to the map."""
        return None

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._pose = compose(new_from_old, self._pose)

    def put_down(self, pose: FloatArray) -> None:
        """Be there; the map stays."""
        self.set(pose, VARIANCE_MIN)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._pose.copy()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._covariance.copy()
