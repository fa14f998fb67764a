# SPDX-License-Identifier: MIT
"""Low-variance resampling on the wheel, and when to do it: log-weights in, indices out.

Thrun, Burgard, Fox (2005), table 4.4; effective sample size after Liu (1996).
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import IntArray


def normalise(log_weights: FloatArray) -> FloatArray:
    """(P,) weights that sum to 1; a constant added to all log-weights changes nothing."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def effective_sample_size(weights: FloatArray) -> float:
    """1 / sum of squared weights: P when all are equal, 1 when one has it all."""
    return 1.0 / float((weights**2).sum())


def resample_low_variance(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """(P,) indices; index i is among them P * weights[i] times on average.

    One spin of a wheel with P even pointers: every count is the floor or ceiling of its mean.
    """
    count = len(weights)
    pointers = (rng.random() + np.arange(count)) / count
    edges = np.cumsum(weights)
    return np.asarray(np.searchsorted(edges / edges[-1], pointers, side="right"))
