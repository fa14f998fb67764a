# SPDX-License-Identifier: MIT
"""Angles in radians, wrapped to [-pi, pi)."""

from __future__ import annotations

import math
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@overload
def wrap_rad(angle_rad: float) -> float: ...
@overload
def wrap_rad(angle_rad: FloatArray) -> FloatArray: ...
def wrap_rad(angle_rad: float | FloatArray) -> float | FloatArray:
    """Wrap to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def circular_mean_rad(angles_rad: ArrayLike, weights: ArrayLike | None = None) -> float:
    """Direction of the (weighted) mean unit vector; the paper's eq. 5 with sine over cosine."""
    angles = np.asarray(angles_rad, dtype=np.float64)
    w = np.ones_like(angles) if weights is None else np.asarray(weights, dtype=np.float64)
    return math.atan2(float(w @ np.sin(angles)), float(w @ np.cos(angles)))
