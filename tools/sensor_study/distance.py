# SPDX-License-Identifier: MIT
"""How far two samples are apart, and how far real ones are among themselves.

Kolmogorov-Smirnov: largest difference of the distribution functions, 0 to 1. Wasserstein: how
far values must be moved on average, in their own unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import ks_2samp, wasserstein_distance

from ins_robot.geometry.angles import FloatArray
from sensor_study.quantity import Quantity

KS_MAX = 0.99


@dataclass(frozen=True)
class Verdict:
    """Distances of one quantity; `allowed_*` is the largest among real parts."""

    quantity: Quantity
    ks: float
    allowed_ks: float
    wasserstein: float
    allowed_wasserstein: float

    @property
    def is_within(self) -> bool:
        """Whether either distance is within what real recordings differ by.

        Parts wholly apart (KS 1) allow every distribution: then only the other one counts.
        """
        is_ks_within = self.ks <= self.allowed_ks < KS_MAX
        return is_ks_within or self.wasserstein <= self.allowed_wasserstein


def ks(one: FloatArray, other: FloatArray) -> float:
    return float(ks_2samp(one, other, method="asymp").statistic)


def judge(quantity: Quantity) -> Verdict:
    """The simulator against all parts together, beside the parts against one another."""
    real = np.concatenate(quantity.real)
    simulated = np.concatenate(quantity.simulated)
    pairs = list(combinations(quantity.real, 2))
    return Verdict(
        quantity,
        ks(real, simulated),
        max(ks(a, b) for a, b in pairs),
        float(wasserstein_distance(real, simulated)),
        max(float(wasserstein_distance(a, b)) for a, b in pairs),
    )
