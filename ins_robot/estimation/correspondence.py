# SPDX-License-Identifier: MIT
"""Which feature is which landmark, when the pose is off by more than features are apart.

Two features and two landmarks the same distance apart make a hypothesis of the rigid motion
between prediction and truth; the one with which most features find their landmark wins. All
hypotheses are tried on all candidate pairs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.features import Features
from ins_robot.mapping.occupancy_grid import IntArray

PRIOR_STDS = 3.0
REACH_MIN_M, REACH_MAX_M = 0.15, 1.2  # how far a landmark may be from where it is expected
TURN_MIN_RAD, TURN_MAX_RAD = math.radians(2.0), math.radians(25.0)
BASELINE_MIN_M = 0.6
LENGTH_TOLERANCE_M = 0.12
FLOOR_STD_M, FLOOR_STD_RAD = 0.03, math.radians(1.5)
GATE_CHI2 = 9.0
HYPOTHESES_MAX = 400
TO_COMPLEX = np.array([1.0, 1.0j])
PRIOR_WORTH = 1.0 / GATE_CHI2  # of a feature, per chi-squared off the prior
TO_COMPLEX = np.array([1.0, 1.0j])
PRIOR_WORTH = 1.0 / GATE_CHI2  # of a feature, per chi-squared off the prior
RIVAL_M, RIVAL_RAD = 0.2, math.radians(3.0)  # a motion this far away is another one
RIVAL_MARGIN = -9  # features by which the best must lead

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class Correspondence:
    """M pairs that agree on one motion, and how sure each is.

    Attributes
    ----------
    features, landmarks : (M,) int64
        Rows in what was given.
    placed_m : (M, 2)
        The features, at the predicted pose.
    std_m : (M,)
        Standard deviation of a coordinate of a pair's difference.
    turns_rad, turn_vars : (M,)
        How far the predicted pose should turn for their headings to agree, and the variance.
    """

    features: IntArray
    landmarks: IntArray
    placed_m: FloatArray
    std_m: FloatArray
    turns_rad: FloatArray
    turn_vars: FloatArray

    def __len__(self) -> int:
        return len(self.features)


def correspond(
    features: Features, landmarks: Features, pose: FloatArray, covariance: FloatArray
) -> Correspondence:
    """Pairs of features (base frame) and landmarks (map frame); none when nothing fits.

    `pose` (3,) with `covariance` (3, 3) is where the base is expected in the map.
    """
    seen = features.at(Pose2.from_array(pose))
    std_m = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    std_rad = math.sqrt(float(covariance[2, 2]))
    turn_max = min(max(PRIOR_STDS * std_rad, TURN_MIN_RAD), TURN_MAX_RAD)
    shift_max = min(max(PRIOR_STDS * std_m, REACH_MIN_M), REACH_MAX_M)
    range_m = np.hypot(*features.points_m.T)
    reach_m = np.minimum(shift_max + turn_max * range_m, REACH_MAX_M + 0.1 * range_m)
    off = landmarks.points_m - seen.points_m[:, None]
    is_candidate = (off**2).sum(axis=-1) < reach_m[:, None] ** 2
    is_candidate &= seen.kinds[:, None] == landmarks.kinds
    ahead = wrap_rad(landmarks.headings_rad - seen.headings_rad[:, None])
    ahead_var = seen.heading_vars[:, None] + landmarks.heading_vars + FLOOR_STD_RAD**2
    is_candidate &= np.abs(ahead) < turn_max + PRIOR_STDS * np.sqrt(ahead_var)
    f, m = np.nonzero(is_candidate)  # C candidate pairs, by feature
    if not len(f):
        return _pairs(f, m, seen, np.zeros((0, 2, 2)), ahead[f, m], ahead_var[f, m])
    ahead, ahead_var = ahead[f, m], ahead_var[f, m]  # (C,)
    spread = seen.covariances[f] + landmarks.covariances[m] + np.eye(2) * FLOOR_STD_M**2
    here = (seen.points_m[f] - pose[:2]) @ TO_COMPLEX
    there = (landmarks.points_m[m] - pose[:2]) @ TO_COMPLEX
    turns, shifts = _hypotheses(
        f, m, here, there, turn_max, np.where(ahead_var < 1.0, ahead, 0.0)
    )
    is_near = np.abs(shifts) < shift_max
    turns, shifts = turns[is_near], shifts[is_near]
    moved = here * np.exp(1j * turns)[:, None] + shifts[:, None]  # (H, C)
    miss = there - moved
    weight = np.linalg.inv(spread)
    chi2 = (
        weight[:, 0, 0] * miss.real**2
        + 2.0 * weight[:, 0, 1] * miss.real * miss.imag
        + weight[:, 1, 1] * miss.imag**2
        + wrap_rad(ahead - turns[:, None]) ** 2 / ahead_var
    )
    first = np.flatnonzero(np.concatenate([[True], np.diff(f) > 0]))
    found = np.maximum.reduceat(np.maximum(0.0, 1.0 - chi2 / GATE_CHI2), first, axis=1)
    step = np.stack([shifts.real, shifts.imag, turns], axis=-1)
    strange = np.einsum("hi,ij,hj->h", step, np.linalg.inv(covariance), step)
    score = found.sum(axis=1) - PRIOR_WORTH * strange
    best = chi2[int(np.argmax(score))]
    kept: list[int] = []
    for k in np.argsort(best, kind="stable").tolist():  # each feature and landmark once
        if best[k] > GATE_CHI2:
            break
        if all(f[k] != f[other] and m[k] != m[other] for other in kept):
            kept.append(k)
    index = np.array(sorted(kept), dtype=np.int64)
    return _pairs(f[index], m[index], seen, spread[index], ahead[index], ahead_var[index])


def _hypotheses(
    f: IntArray,
    m: IntArray,
    here: Complex,
    there: Complex,
    turn_max: float,
    ahead: FloatArray,
) -> tuple[FloatArray, Complex]:
    """Turns (H,) about the base and shifts (H,) of it: none, by one pair, by two pairs.

    `here` and `there` (C,) are seen from the predicted base.
    """
    one, two = np.triu_indices(len(f), 1)
    is_pair = (f[one] != f[two]) & (m[one] != m[two])
    one, two = one[is_pair], two[is_pair]
    a, b = here[two] - here[one], there[two] - there[one]
    turns = np.angle(b * a.conj())
    is_rigid = (np.abs(a) > BASELINE_MIN_M) & (np.abs(turns) < turn_max)
    is_rigid &= np.abs(np.abs(a) - np.abs(b)) < LENGTH_TOLERANCE_M
    one, two, turns = one[is_rigid], two[is_rigid], turns[is_rigid]
    if len(one) > HYPOTHESES_MAX:
        spaced = np.linspace(0, len(one) - 1, HYPOTHESES_MAX).astype(np.int64)
        one, two, turns = one[spaced], two[spaced], turns[spaced]
    shifts = 0.5 * (there[one] + there[two] - np.exp(1j * turns) * (here[one] + here[two]))
    return (
        np.concatenate([[0.0], ahead, turns]),
        np.concatenate([[0.0], there - np.exp(1j * ahead) * here, shifts]),
    )


def _pairs(
    f: IntArray,
    m: IntArray,
    seen: Features,
    spread: FloatArray,
    ahead: FloatArray,
    ahead_var: FloatArray,
) -> Correspondence:
    return Correspondence(
        features=f,
        landmarks=m,
        placed_m=seen.points_m[f],
        std_m=np.sqrt(0.5 * np.trace(spread, axis1=1, axis2=2)),
        turns_rad=ahead,
        turn_vars=ahead_var,
    )
