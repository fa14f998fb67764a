# SPDX-License-Identifier: MIT
"""Sim(2): a rotation, a scale and a translation of the plane; the algebra only.

`r_from_l` carries points of frame l into frame r by the paper's eq. 1: lambda R l + t = r.
Fitting one to pairs of points is `ins_robot.estimation.similarity`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2


@dataclass(frozen=True, slots=True)
class Similarity2:
    """A similarity of the plane.

    Attributes
    ----------
    scale : float
        The paper's lambda, above 0.
    turn_rad : float
        Rotation, counter-clockwise (the paper's alpha).
    x_m, y_m : float
        Translation (the paper's t).
    """

    scale: float = 1.0
    turn_rad: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0

    def __matmul__(self, other: Similarity2) -> Similarity2:
        """Compose: first `other`, then `self`."""
        x, y = self.apply([other.x_m, other.y_m])
        turn_rad = wrap_rad(self.turn_rad + other.turn_rad)
        return Similarity2(self.scale * other.scale, turn_rad, float(x), float(y))

    def inverse(self) -> Similarity2:
        """The similarity that undoes this one."""
        back = Similarity2(1.0 / self.scale, wrap_rad(-self.turn_rad))
        x, y = back.apply([-self.x_m, -self.y_m])
        return Similarity2(back.scale, back.turn_rad, float(x), float(y))

    def apply(self, points_m: ArrayLike) -> FloatArray:
        """Carry points, shape (..., 2)."""
        points = np.asarray(points_m, dtype=np.float64)
        a = self.scale * math.cos(self.turn_rad)
        b = self.scale * math.sin(self.turn_rad)
        x, y = points[..., 0], points[..., 1]
        return np.stack([a * x - b * y + self.x_m, b * x + a * y + self.y_m], axis=-1)

    def apply_to_pose(self, pose: Pose2) -> Pose2:
        """Where a pose of frame l is in frame r; a heading turns, a scale leaves it alone."""
        x, y = self.apply([pose.x_m, pose.y_m])
        return Pose2(float(x), float(y), wrap_rad(pose.heading_rad + self.turn_rad))
