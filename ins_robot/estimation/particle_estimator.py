# SPDX-License-Identifier: MIT
"""Particles on a map of scans: the paper's section 5.2 with the whole scan as the measurement.

Each scan is laid on the local map; what it knows sharpens the draw of every particle, and the
likelihood of its readings weighs them.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from ins_robot.config import SlamConfig
from ins_robot.estimation.particle_filter import ParticleFilter
from ins_robot.estimation.protocol import Correction, Observation
from ins_robot.estimation.scan_matching import Alignment, align, log_likelihoods, search
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.surfels import Surfels
from ins_robot.messages import MotionIncrement

SEARCH_STDS = 3.0
SEARCH_HALF_MIN_M = 0.1
SEARCH_HALF_MAX_M = 0.8
SEARCH_TURN_MIN_RAD = math.radians(3.0)
SEARCH_TURN_MAX_RAD = math.radians(25.0)
SURE_STD_M = 0.08  # a prior this sure needs no search, descent alone gets there
SURE_STD_RAD = math.radians(3.0)
SURE_KERNEL = 2.0
INLIER_SHARE_MIN = 0.3
INLIER_SHARE_GOOD = 0.55
INLIER_SHARE_SURE = 0.8  # where the robot may have turned to anywhere
TURN_MARGIN = 5.0  # nats by which a far turn must be better than a near one
INLIERS_MIN = 15
# when a gyro's bias has stepped the heading is off by this, and the way that was driven by it
ASTRAY = np.diag([0.2**2, 0.2**2, math.radians(15.0) ** 2])
INLIER_SHARE_ASTRAY = 0.7
INLIER_SHARE_MORE = 0.1  # than near the prior
ASTRAY_INLIERS_MIN = 60
ASTRAY_STD_M = 0.03
PULL_MAX = 1.0  # chi-squared of scan against match; below 0.5 unless the prior is wrong
INFORMATION_MIN = 10.0 * np.eye(3)  # along a corridor there is none
SURPRISE_MAX = 36.0  # chi-squared of match against prior beyond which the odometry decides


class ParticleEstimator:
    """Predict, sharpen by matching, weigh, resample, average."""

    closes_loops: ClassVar[bool] = True

    def __init__(self, config: SlamConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._filter = ParticleFilter(config.particles, np.zeros(3), rng)

    def predict(self, motion: MotionIncrement) -> None:
        """Take a motion in."""
        self._filter.predict(motion)

    def correct(self, observation: Observation) -> Correction | None:
        """Lay a scan on the local map; None when it fits badly, and odometry decides."""
        scan, field = observation.surfels, observation.field
        if field is None or len(scan) == 0:
            return None
        match, doubt = self._lay(scan, field)
        if match is None:
            return None
        known = scan.take(match.is_inlier)
        self._filter.weigh(match, lambda poses: log_likelihoods(field, known, poses))
        self._filter.resample_below(self._config.resample_below)
        return Correction(match=match, doubt=doubt)

    def _lay(
        self, scan: Surfels, field: LikelihoodField
    ) -> tuple[Alignment | None, FloatArray | None]:
        """Where the scan fits; and by how much the motion is to be doubted for that, if at all.

        Astray, farther than the motion explains, is looked when no place near is good, or the
        scan pulls away from it; taken is a place where more of the scan is on the map, and that
        the scan tells in all directions: one wall fits another one anywhere.
        """
        mean, covariance = self._filter.prior()
        near = _match(scan, field, mean, covariance)
        if near is not None and _is_at_ease(near):
            return near, None
        far = _match(scan, field, mean, covariance + ASTRAY)
        least = 0.0 if near is None else near.inlier_share + INLIER_SHARE_MORE
        if far is None or far.inlier_share < least or not _is_sure(far):
            return near, None
        self._filter.doubt(ASTRAY)
        return far, ASTRAY

    def keep_node(self) -> None:
        """Nodes are left to the map."""

    def moved_nodes(self) -> FloatArray | None:
        """Nodes are left to the map."""
        return None

    def carry(self, new_from_old: FloatArray) -> None:
        """Move with the map."""
        self._filter.carry(new_from_old)

    def put_down(self, pose: FloatArray) -> None:
        """Be there; the map stays."""
        self._filter.gather(pose)

    def pose(self) -> FloatArray:
        """(3,)."""
        return self._filter.mean()

    def covariance(self) -> FloatArray:
        """(3, 3)."""
        return self._filter.covariance()


def _match(
    scan: Surfels, field: LikelihoodField, prior: FloatArray, covariance: FloatArray
) -> Alignment | None:
    """Best alignment near the prior, or None when it is poor or incredible."""
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    std_m = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    std_rad = math.sqrt(float(covariance[2, 2]))
    match = None
    if std_m < SURE_STD_M and std_rad < SURE_STD_RAD:
        match = align(field, scan, prior[None], prior, information, kernel_start=SURE_KERNEL)
    half_width = min(max(SEARCH_STDS * std_m, SEARCH_HALF_MIN_M), SEARCH_HALF_MAX_M)
    half_turn = min(max(SEARCH_STDS * std_rad, SEARCH_TURN_MIN_RAD), math.pi)
    near = min(half_turn, SEARCH_TURN_MAX_RAD)
    if match is None or match.inlier_share < INLIER_SHARE_GOOD:
        starts = _searched(scan, field, prior, information, half_width, near, [0.0])
        match = align(field, scan, starts, prior, information)
    if half_turn > near and match.inlier_share < INLIER_SHARE_SURE:
        count = math.ceil((half_turn - near) / (2.0 * near))
        half_window = 0.5 * (half_turn - near) / count
        right = [near + (2 * k + 1) * half_window for k in range(count)]
        turns = [*right, *(-turn for turn in right)]
        starts = _searched(scan, field, prior, information, half_width, half_window, turns)
        far = align(field, scan, starts, prior, information)
        if far.cost < match.cost - TURN_MARGIN:
            match = far
    if match.inliers < INLIERS_MIN or match.inlier_share < INLIER_SHARE_MIN:
        return None
    off = match.pose - prior
    off[2] = wrap_rad(float(off[2]))
    return match if float(off @ information @ off) < SURPRISE_MAX else None


def _is_at_ease(match: Alignment) -> bool:
    """Whether most of the scan is on the map, and does not pull away from the prior."""
    pull = np.linalg.solve(match.information + INFORMATION_MIN, match.gradient)
    is_pulled = float(match.gradient @ pull) > PULL_MAX
    return match.inlier_share >= INLIER_SHARE_GOOD and not is_pulled


def _is_sure(match: Alignment) -> bool:
    """Whether a place is told by the scan alone."""
    least = float(np.linalg.eigvalsh(match.information[:2, :2])[0])
    is_held = least * ASTRAY_STD_M**2 >= 1.0 and match.inliers >= ASTRAY_INLIERS_MIN
    return is_held and match.inlier_share >= INLIER_SHARE_ASTRAY


def _searched(
    scan: Surfels,
    field: LikelihoodField,
    prior: FloatArray,
    information: FloatArray,
    half_width_m: float,
    half_window_rad: float,
    turns_rad: list[float],
) -> FloatArray:
    """(W + 1, 3) best pose of each window, turned so far from the prior; and the prior."""
    starts = [prior]
    for turn_rad in turns_rad:
        centre = prior + np.array([0.0, 0.0, turn_rad])
        starts.append(
            search(field, scan, centre, half_width_m, half_window_rad, information).pose
        )
    return np.stack(starts[::-1])
