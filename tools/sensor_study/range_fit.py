# SPDX-License-Identifier: MIT
"""The LRF's error characteristic fitted: standard deviation of single readings over range.

In: ranges and standard deviations of steady beams. Out: floor, growth and exponent of
hypot(floor, growth r^p), with their spread over bootstrap draws of whole standstills' beams.
Fitted in logarithms, because surfaces differ by factors, and robustly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ins_robot.geometry.angles import FloatArray

STD_MIN_M = (
    2e-4  # a beam that always says the same millimetre scatters by less than we can tell
)
_SOFT = 0.5  # logarithm; farther off counts less
_START = (np.log(4e-4), np.log(1e-3), 2.5)


@dataclass(frozen=True)
class RangeLaw:
    """hypot(floor_m, growth r^exponent), and the standard errors of the three."""

    floor_m: float
    growth: float
    exponent: float
    floor_se_m: float = 0.0
    growth_se: float = 0.0
    exponent_se: float = 0.0
    cost: float = 0.0

    def std_m(self, ranges_m: FloatArray) -> FloatArray:
        return np.hypot(self.floor_m, self.growth * ranges_m**self.exponent)

    def __str__(self) -> str:
        return (
            f"std = hypot({1e3 * self.floor_m:.2f} +- {1e3 * self.floor_se_m:.2f} mm, "
            f"({1e3 * self.growth:.2f} +- {1e3 * self.growth_se:.2f}) mm r^"
            f"{self.exponent:.2f} +- {self.exponent_se:.2f}), cost {self.cost:.1f}"
        )


def fit_range_law(
    ranges_m: FloatArray,
    stds_m: FloatArray,
    rng: np.random.Generator,
    exponent: float | None = None,
    draws: int = 60,
) -> RangeLaw:
    """The law of these steady beams (N,); `exponent` None: fitted as well."""
    kept = np.isfinite(stds_m)
    ranges_m, stds_m = ranges_m[kept], np.maximum(stds_m[kept], STD_MIN_M)
    best, cost = _fit(ranges_m, stds_m, exponent)
    picks = rng.integers(len(ranges_m), size=(draws, len(ranges_m)))
    others = np.array([_fit(ranges_m[pick], stds_m[pick], exponent)[0] for pick in picks])
    return RangeLaw(*best, *others.std(axis=0), cost=cost)


def _fit(
    ranges_m: FloatArray, stds_m: FloatArray, exponent: float | None
) -> tuple[tuple[float, float, float], float]:
    log_stds = np.log(stds_m)

    def residuals(x: FloatArray) -> FloatArray:
        power = x[2] if exponent is None else exponent
        return np.log(np.hypot(np.exp(x[0]), np.exp(x[1]) * ranges_m**power)) - log_stds

    start = _START if exponent is None else _START[:2]
    found = least_squares(residuals, start, loss="soft_l1", f_scale=_SOFT)
    power = float(found.x[2]) if exponent is None else exponent
    return (float(np.exp(found.x[0])), float(np.exp(found.x[1])), power), float(found.cost)
