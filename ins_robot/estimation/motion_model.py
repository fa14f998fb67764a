# SPDX-License-Identifier: MIT
"""How the base moved, with its doubt: motion increments sampled, chained, turned.

An increment brings its own covariance: from the Kalman filter, or from the model of a log's
odometry. Thrun, Burgard, Fox (2005), chapter 5.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import compose
from ins_robot.messages import MotionIncrement


def chain(first: MotionIncrement, second: MotionIncrement) -> MotionIncrement:
    """Two increments one after the other, as one."""
    c, s = math.cos(first.delta.heading_rad), math.sin(first.delta.heading_rad)
    x, y = second.delta.x_m, second.delta.y_m
    by_first = np.array(
        [[1.0, 0.0, -s * x - c * y], [0.0, 1.0, c * x - s * y], [0.0, 0.0, 1.0]]
    )
    by_second = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return MotionIncrement(
        from_stamp_s=first.from_stamp_s,
        to_stamp_s=second.to_stamp_s,
        delta=first.delta @ second.delta,
        covariance=by_first @ first.covariance @ by_first.T
        + by_second @ second.covariance @ by_second.T,
        repeated=max(first.repeated, second.repeated),
    )


def turned(covariance: FloatArray, heading_rad: float) -> FloatArray:
    """(3, 3) covariance of an increment, in the frame where the base has that heading."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(rotation @ covariance @ rotation.T)


def sample_motion(
    poses: FloatArray, motion: MotionIncrement, rng: np.random.Generator
) -> FloatArray:
    """(P, 3) poses moved by one draw of the increment each (the paper's eq. 3)."""
    mean = motion.delta.as_array()
    root = np.linalg.cholesky(motion.covariance + np.eye(3) * 1e-12)
    return compose(poses, mean + rng.standard_normal(poses.shape) @ root.T)
