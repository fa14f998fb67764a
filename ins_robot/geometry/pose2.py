# SPDX-License-Identifier: MIT
"""SE(2): one pose (`Pose2`) and the same algebra on batches of shape (..., 3).

A pose called `map_from_base` carries points of the base frame into the map frame, so products
read off: `map_from_lrf = map_from_base @ base_from_lrf`. Batches hold (x_m, y_m, heading_rad).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ins_robot.geometry.angles import FloatArray, wrap_rad


@dataclass(frozen=True, slots=True)
class Pose2:
    """A rigid motion of the plane.

    Attributes
    ----------
    x_m, y_m : float
        Translation.
    heading_rad : float
        Rotation, counter-clockwise, wrapped to [-pi, pi) by the operations below.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: first `other`, then `self`."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return Pose2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_rad(self.heading_rad + other.heading_rad),
        )

    def inverse(self) -> Pose2:
        """The motion that undoes this one."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return Pose2(
            -c * self.x_m - s * self.y_m,
            s * self.x_m - c * self.y_m,
            wrap_rad(-self.heading_rad),
        )

    def between(self, other: Pose2) -> Pose2:
        """Pose of `other` seen from `self`: `self @ self.between(other) == other`."""
        return self.inverse() @ other

    def apply(self, points_m: ArrayLike) -> FloatArray:
        """Carry points, shape (..., 2), into the frame on the left of this pose's name."""
        return transform_points(self.as_array(), points_m)

    def distance_m(self, other: Pose2) -> float:
        """Distance between the two origins."""
        return math.hypot(other.x_m - self.x_m, other.y_m - self.y_m)

    def as_array(self) -> FloatArray:
        """(3,) float64: x_m, y_m, heading_rad."""
        return np.array([self.x_m, self.y_m, self.heading_rad])

    @staticmethod
    def from_array(pose: ArrayLike) -> Pose2:
        """Inverse of `as_array`; wraps the heading."""
        x, y, heading = np.asarray(pose, dtype=np.float64)
        return Pose2(float(x), float(y), wrap_rad(float(heading)))


def compose(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """`a @ b` on batches that broadcast against each other, shape (..., 3)."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _rows(
        a[..., 0] + c * b[..., 0] - s * b[..., 1],
        a[..., 1] + s * b[..., 0] + c * b[..., 1],
        wrap_rad(a[..., 2] + b[..., 2]),
    )


def inverse(a: ArrayLike) -> FloatArray:
    """Inverse of each pose of a batch, shape (..., 3)."""
    a = np.asarray(a, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _rows(
        -c * a[..., 0] - s * a[..., 1],
        s * a[..., 0] - c * a[..., 1],
        wrap_rad(-a[..., 2]),
    )


def between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Poses of `b` seen from `a`, shape (..., 3)."""
    return compose(inverse(a), b)


def transform_points(poses: ArrayLike, points_m: ArrayLike) -> FloatArray:
    """Carry points (N, 2) by a pose (3,) -> (N, 2), or by poses (P, 3) -> (P, N, 2)."""
    poses = np.asarray(poses, dtype=np.float64)
    points = np.asarray(points_m, dtype=np.float64)
    c, s = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x, y = points[..., 0], points[..., 1]
    return _rows(poses[..., 0, None] + c * x - s * y, poses[..., 1, None] + s * x + c * y)


def _rows(*columns: FloatArray) -> FloatArray:
    """(..., C) of C arrays (...); `np.stack` takes twice as long."""
    rows = np.empty((*columns[0].shape, len(columns)))
    for k, column in enumerate(columns):
        rows[..., k] = column
    return rows
