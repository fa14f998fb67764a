# SPDX-License-Identifier: MIT
"""What stands for odometry when a person carries the LRF: the places where it was put down.

Between two of them nothing is known but what the person was asked to do; that they did it only
about is the covariance. Same questions, same answers as `core.odometry.Odometry`.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.config import BaseConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import ImuSample, MotionIncrement, WheelSample


class CarriedOdometry:
    """Poses in the odom frame, which begins where the LRF was put down first."""

    is_ready = True

    def __init__(self, config: BaseConfig) -> None:
        std_m, std_rad = config.carried_std_m, math.radians(config.carried_std_deg)
        self._covariance = np.diag(np.square([std_m, std_m, std_rad]))
        self._stamps_s = [-math.inf]
        self._poses = [np.zeros(3)]

    @property
    def pose(self) -> Pose2:
        """odom_from_base, as the person says."""
        return Pose2.from_array(self._poses[-1])

    def put_down(self, stamp_s: float, odom_from_base: Pose2) -> None:
        """The LRF was carried there; it stands since `stamp_s`."""
        self._stamps_s.append(stamp_s)
        self._poses.append(odom_from_base.as_array())

    def on_imu(self, sample: ImuSample) -> None:
        """Nothing is mounted that could tell."""

    def on_wheels(self, sample: WheelSample) -> None:
        """There are none."""

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) odom_from_base at stamps (N,)."""
        return np.stack([self._poses[k] for k in self._last_before(stamps_s)])

    def increment(self, from_s: float, to_s: float) -> MotionIncrement:
        """Motion between two stamps, in the base frame at the first."""
        before, after = self._last_before(np.array([from_s, to_s]))
        start, end = Pose2.from_array(self._poses[before]), Pose2.from_array(self._poses[after])
        covariance = self._covariance.copy() if after > before else np.zeros((3, 3))
        return MotionIncrement(
            from_stamp_s=from_s,
            to_stamp_s=to_s,
            delta=start.between(end),
            covariance=covariance,
        )

    def _last_before(self, stamps_s: FloatArray) -> list[int]:
        after = np.searchsorted(self._stamps_s, stamps_s, side="right")
        return [int(k) - 1 for k in after]
