# SPDX-License-Identifier: MIT
"""The paper's section 5.1: features against objects placed before give a similarity transform.

The transform that carries the features, placed by odometry, onto the objects corrects the pose;
the features are then placed again from there and become objects. What lambda says about the
wheels shows over a way, see `ins_robot.estimation.wheel_scale`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from ins_robot.estimation.correspondence import correspond
from ins_robot.estimation.landmarks import LandmarkMaps, Sightings
from ins_robot.estimation.odometry_estimator import OdometryEstimator
from ins_robot.estimation.pose_fix import fix_pose
from ins_robot.estimation.protocol import FEATURE_REACH_M, Correction, Observation
from ins_robot.geometry.angles import FloatArray
from ins_robot.messages import MotionIncrement

OBJECTS_MAX = 1024
REACH_M = FEATURE_REACH_M + 2.0


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
        worth_less = replace(motion, covariance=motion.covariance * motion.repeated)
        self._doubtful.predict(worth_less)

    def correct(self, observation: Observation) -> Correction | None:
        """Lay the features on the objects; None when they do not tell where."""
        sightings = Sightings.of(observation.features)
        pose, covariance = self.pose(), self._doubtful.covariance()
        slots = self._objects.near(pose, REACH_M)
        known = self._objects.of(0, slots)
        pairs = correspond(sightings.features, known, pose, covariance)
        fix = fix_pose(pairs, known.points_m[pairs.landmarks], pose, covariance)
        if fix is not None:
            for odometry in (self._odometry, self._doubtful):
                odometry.set(fix.pose, fix.covariance)
        here = self.pose()[None]
        chosen = self._objects.associate(here, sightings, slots, self.covariance())
        self._objects.learn(here, sightings, chosen, self.covariance())
        return None if fix is None else Correction()

    def keep_node(self) -> None:
        """Nodes are left to the map."""

    def moved_nodes(self) -> FloatArray | None:
        """Nodes are left to the map."""
        return None

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._odometry.carry(new_from_old)
        self._doubtful.carry(new_from_old)
        self._objects.carry(new_from_old)

    def put_down(self, pose: FloatArray) -> None:
        """Be there; the objects stay."""
        self._odometry.put_down(pose)
        self._doubtful.put_down(pose)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._odometry.pose()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._odometry.covariance()
