# SPDX-License-Identifier: MIT
"""Fit of a similarity to pairs of points, lambda R l + t = r (the paper's section 5.1, eq. 1).

Minimises the sum of absolute errors, |lambda R l + t - r| over its standard deviation, by
iterative re-weighting; start and every step are the closed form of least squares (Umeyama 1991,
eq. 40-43), which in the plane is one division of complex numbers. Pairs that stay far off are
refused and the rest is fitted again; sets of pairs without an answer are refused by name.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.errors import DegenerateGeometryError
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.similarity2 import Similarity2
from ins_robot.mapping.occupancy_grid import BoolArray

PAIRS_MIN = 2
SPREAD_STDS_MIN = 2.0  # the points must spread further than their middle errs, this many times
ITERATIONS = 60
ROUNDS = 5  # of refusing outliers
COINCIDENT_M2 = 1e-12  # relative to the points' distance from the origin
CONVERGED = 1e-7  # relative change of the transform
ERROR_FLOOR = 1e-9  # of a deviation or a metre: weights are one over the error
OUTLIER_STDS = 4.0
MEDIAN_OF_RAYLEIGH = math.sqrt(
    2.0 * math.log(2.0)
)  # median error per deviation of a coordinate
SPATIAL_MEDIAN_VARIANCE = (
    4.0 / math.pi
)  # of the least absolute error, over least squares', in 2-D
AGREEING_SHARE_MIN = 0.5

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimilarityFit:
    """A similarity and how far to trust it.

    Attributes
    ----------
    transform : Similarity2
        r_from_l.
    covariance : (4, 4)
        Over scale, turn_rad, x_m, y_m; translation as at the origin of r.
    std_m : float
        Standard deviation of a coordinate of r, by the pairs' errors.
    is_inlier : (N,) bool
        The pairs that were not refused.
    """

    transform: Similarity2
    covariance: FloatArray
    std_m: float
    is_inlier: BoolArray

    @property
    def scale_std(self) -> float:
        """Standard deviation of the scale."""
        return math.sqrt(float(self.covariance[0, 0]))


def fit_similarity(
    l_m: FloatArray,
    r_m: FloatArray,
    std_m: FloatArray | None = None,
    *,
    fixed_scale: float | None = None,
) -> SimilarityFit:
    """Similarity that carries `l_m` onto `r_m` with the least sum of absolute errors.

    Parameters
    ----------
    l_m, r_m : (N, 2) float64
        Corresponding points, row i with row i, each set in its own frame.
    std_m : (N,) float64, optional
        Standard deviation of each pair; equal if not given.
    fixed_scale : float, optional
        Keep lambda at this: 1 for a rigid motion.

    Raises
    ------
    DegenerateGeometryError
        Too few pairs, numbers that are not finite, points of either set that coincide, or no
        transform with which half of the pairs agree.
    """
    count = len(l_m)
    if count < PAIRS_MIN:
        raise DegenerateGeometryError(
            f"too few pairs: {count}, a similarity needs {PAIRS_MIN}; wait for more features"
        )
    if not (np.isfinite(l_m).all() and np.isfinite(r_m).all()):
        raise DegenerateGeometryError("not finite: a pair holds NaN or infinity; leave it out")
    deviations = np.ones(count) if std_m is None else np.asarray(std_m, dtype=np.float64)
    left, right = l_m[:, 0] + 1j * l_m[:, 1], r_m[:, 0] + 1j * r_m[:, 1]
    is_inlier = np.ones(count, dtype=bool)
    for _ in range(ROUNDS):
        m, t = _least_absolute(
            left[is_inlier], right[is_inlier], deviations[is_inlier], fixed_scale
        )
        errors = np.abs(m * left + t - right) / deviations
        scale = float(np.median(errors[is_inlier])) / MEDIAN_OF_RAYLEIGH
        if std_m is not None:
            scale = max(scale, 1.0)  # better than promised is chance
        was = is_inlier
        is_inlier = errors <= OUTLIER_STDS * scale + ERROR_FLOOR
        if (is_inlier == was).all():
            break
    agreeing = int(is_inlier.sum())
    if agreeing < max(PAIRS_MIN, AGREEING_SHARE_MIN * count):
        raise DegenerateGeometryError(
            f"no consensus: {agreeing} of {count} pairs agree on one transform, half must; "
            "the correspondences are wrong"
        )
    m, t = _least_absolute(
        left[is_inlier], right[is_inlier], deviations[is_inlier], fixed_scale
    )
    unit_var = _unit_variance(np.abs(m * left + t - right)[is_inlier], deviations[is_inlier])
    if std_m is not None:
        unit_var = max(unit_var, 1.0)
    covariance = _covariance(m, left[is_inlier], deviations[is_inlier], unit_var, fixed_scale)
    return SimilarityFit(
        transform=Similarity2(abs(m), cmath.phase(m), t.real, t.imag),
        covariance=covariance,
        std_m=math.sqrt(unit_var) * float(np.median(deviations[is_inlier])),
        is_inlier=is_inlier,
    )


def _least_absolute(
    left: Complex, right: Complex, deviations: FloatArray, fixed_scale: float | None
) -> tuple[complex, complex]:
    """Multiplier m = lambda e^(i alpha) and t of the least sum of absolute errors."""
    _refuse_coincident(left, "l")
    _refuse_coincident(right, "r")
    weights = 1.0 / deviations**2
    m, t = _least_squares(left, right, weights, fixed_scale)
    for _ in range(ITERATIONS):
        errors = np.abs(m * left + t - right) / deviations
        # one over the error turns squares into absolute values (Weiszfeld 1937)
        before = m
        m, t = _least_squares(
            left, right, weights / np.maximum(errors, ERROR_FLOOR), fixed_scale
        )
        if abs(m - before) < CONVERGED * abs(m):
            break
    return m, t


def _least_squares(
    left: Complex, right: Complex, weights: FloatArray, fixed_scale: float | None
) -> tuple[complex, complex]:
    """Umeyama's closed form, weighted; with complex numbers there are no reflections."""
    total = weights.sum()
    l_mean, r_mean = (weights @ left) / total, (weights @ right) / total
    l_off = left - l_mean
    weighted = weights * l_off.conj()
    m = complex((weighted @ (right - r_mean)) / (weighted @ l_off).real)
    if fixed_scale is not None:
        m *= fixed_scale / abs(m)
    return m, complex(r_mean - m * l_mean)


def _refuse_coincident(points: Complex, whose: str) -> None:
    extent_m2 = float(np.mean(np.abs(points - points.mean()) ** 2))
    if extent_m2 <= COINCIDENT_M2 * float(np.mean(np.abs(points) ** 2)):
        raise DegenerateGeometryError(
            f"coincident: the {len(points)} points of {whose} lie within "
            f"{math.sqrt(extent_m2):.2g} m of one another, which has no direction and no scale"
        )


def _unit_variance(errors_m: FloatArray, deviations: FloatArray) -> float:
    """Variance of a coordinate of deviation 1, by the mean error; 2 N - 4 are free."""
    count = len(errors_m)
    freedom = max(2.0 * count - 4.0, 1.0) / (2.0 * count)
    mean = float(np.mean(errors_m / deviations))
    return (mean / math.sqrt(0.5 * math.pi)) ** 2 / freedom


def _covariance(
    m: complex,
    left: Complex,
    deviations: FloatArray,
    unit_var: float,
    fixed_scale: float | None,
) -> FloatArray:
    """(4, 4) over scale, turn, x, y: least squares', by the spatial median's efficiency."""
    weights = 1.0 / deviations**2
    total = float(weights.sum())
    mean = complex(weights @ left) / total
    spread = float(weights @ np.abs(left - mean) ** 2)
    extent_m2 = spread / total
    if extent_m2 < SPREAD_STDS_MIN**2 * unit_var / total:
        raise DegenerateGeometryError(
            f"coincident: the points spread over {math.sqrt(extent_m2):.2g} m, no more than "
            "their errors; turn and scale are not known"
        )
    var = SPATIAL_MEDIAN_VARIANCE * unit_var
    # at the points' middle m and t are independent; t is carried to the origin from there
    of_m = np.diag([0.0 if fixed_scale is not None else var / spread, var / spread])
    of_m[1, 1] /= abs(m) ** 2
    direction = m / abs(m)
    by_scale, by_turn = -direction * mean, -1j * m * mean
    lever = np.array([[by_scale.real, by_turn.real], [by_scale.imag, by_turn.imag]])
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = of_m
    covariance[2:, :2] = lever @ of_m
    covariance[:2, 2:] = covariance[2:, :2].T
    covariance[2:, 2:] = lever @ of_m @ lever.T + np.eye(2) * var / total
    return covariance
