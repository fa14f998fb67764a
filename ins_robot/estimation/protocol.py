# SPDX-License-Identifier: MIT
"""What SLAM and a pose estimator say to one another.

SLAM hands over motions and observations; the estimator answers with a pose, and with what it
made of each observation. An observation is a scan in several forms, each made when first asked
for: surfels and a local map for those that match scans, features for those that know landmarks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.features import Features, features_of_scan
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.surfels import Surfels
from ins_robot.messages import LaserScan, MotionIncrement

FEATURE_REACH_M = 10.0  # a beam's width blurs what is further away


class Observation:
    """One scan as estimators want it, all in the base frame; the map in the map frame."""

    def __init__(
        self,
        scan: LaserScan,
        base_from_lrf: Pose2,
        bearing_std_deg: float,
        surfels: Surfels,
        local_field: Callable[[], LikelihoodField | None],
    ) -> None:
        self.surfels = surfels
        self._scan = scan
        self._base_from_lrf = base_from_lrf
        self._bearing_std_rad = math.radians(bearing_std_deg)
        self._local_field = local_field

    @cached_property
    def field(self) -> LikelihoodField | None:
        """The map around the robot; None where there is none yet."""
        return self._local_field()

    @cached_property
    def features(self) -> Features:
        """Corners, wall ends and small objects of the scan."""
        features = features_of_scan(self._scan, self._bearing_std_rad, FEATURE_REACH_M)
        return features.at(self._base_from_lrf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction:
    """A scan corrected the pose; `match` where it was laid on the map as a whole.

    `doubt` (3, 3): so far from where the motion had led that this has to be added to its
    covariance; None: as the motion claims.
    """

    match: Alignment | None = None
    doubt: FloatArray | None = None


class Estimator(Protocol):
    """Where the base is, map_from_base (3,), and how surely (3, 3)."""

    closes_loops: ClassVar[bool]
    """Whether its matches link the map's nodes, so that the graph may move them."""

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""

    def correct(self, observation: Observation) -> Correction | None:
        """Take a scan in; None when the pose did not use it."""

    def keep_node(self) -> None:
        """The map got a node here."""

    def moved_nodes(self) -> FloatArray | None:
        """(K, 3) where the nodes are, if the last scan changed that; otherwise None."""

    def carry(self, new_from_old: FloatArray) -> None:
        """The map under the robot was moved."""

    def put_down(self, pose: FloatArray) -> None:
        """Somebody carried the robot to `pose` (3,); the next motion says how surely."""

    def pose(self) -> FloatArray:
        """(3,)."""

    def covariance(self) -> FloatArray:
        """(3, 3), relative to the map around the robot."""
