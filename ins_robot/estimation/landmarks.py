# SPDX-License-Identifier: MIT
"""Landmark maps, one per particle: features in, a Kalman filter per landmark (section 5.2).

Landmarks are measured in range and bearing (the paper's eq. 4). All particles and landmarks are
worked on at once; each map has the same bounded number of slots, the least seen give way. P
particles, L slots, N slots near the robot, F features of a scan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import transform_points
from ins_robot.mapping.features import Features
from ins_robot.mapping.occupancy_grid import IntArray

GATE_CHI2 = 11.8  # 3 sigma of two dimensions: nearer is the same landmark ...
APART_CHI2 = 30.0  # ... further is another one, and in between nobody knows
APART_M = 0.25
SEEN_OFTEN, PATIENCE = 3, 40  # what was seen less often, scans ago, was chance
NEW, UNCLEAR = -1, -2  # instead of a slot
NO_KIND = -1
TURN_CHI2, TURN_STD_RAD = 11.0, 0.03  # what points elsewhere is something else
RANGE_STD_M = 0.02  # what a landmark is off, apart from its covariance ...
BEARING_STD_RAD = 0.008  # ... seen along and across
DISTANCE_MIN_M = 0.05
VARIANCE_FLOOR_M2 = 0.005**2  # a landmark never becomes surer: it is no point


@dataclass(frozen=True, slots=True, kw_only=True)
class Sightings:
    """Features in range and bearing about the base: (F, 2) and covariance (F, 2, 2)."""

    features: Features
    polar: FloatArray
    covariances: FloatArray

    @staticmethod
    def of(features: Features) -> Sightings:
        """Features in the base frame; those at its origin have no bearing and are left out."""
        features = features.take(np.hypot(*features.points_m.T) > DISTANCE_MIN_M)
        x, y = features.points_m.T
        distance = np.hypot(x, y)
        jacobian = np.stack(
            [
                np.stack([x / distance, y / distance], axis=-1),
                np.stack([-y / distance**2, x / distance**2], axis=-1),
            ],
            axis=1,
        )
        noise = jacobian @ features.covariances @ jacobian.swapaxes(1, 2)
        return Sightings(
            features=features,
            polar=np.stack([distance, np.arctan2(y, x)], axis=-1),
            covariances=noise + np.diag([RANGE_STD_M**2, BEARING_STD_RAD**2]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovations:
    """What is seen, less what was expected, (..., 2), with all that it depends on."""

    error: FloatArray  # (..., 2) range, bearing
    covariance: FloatArray  # (..., 2, 2)
    by_pose: FloatArray  # (..., 2, 3)
    by_landmark: FloatArray  # (..., 2, 2)

    def chi2(self) -> FloatArray:
        """(...) squared Mahalanobis length."""
        a, b, d = (
            self.covariance[..., 0, 0],
            self.covariance[..., 0, 1],
            self.covariance[..., 1, 1],
        )
        x, y = self.error[..., 0], self.error[..., 1]
        return np.asarray((d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b))


class LandmarkMaps:
    """Landmarks of P particles.

    Attributes
    ----------
    points_m : (P, L, 2)
    covariances : (P, L, 2, 2)
    kinds : (P, L) int64
        `FeatureKind`, NO_KIND where the slot is free.
    headings_rad, heading_vars : (P, L)
        As those of features.
    seen : (P, L) int64
        How often.
    """

    def __init__(self, particles: int, capacity: int) -> None:
        self.points_m = np.zeros((particles, capacity, 2))
        self.covariances = np.zeros((particles, capacity, 2, 2))
        self.kinds = np.full((particles, capacity), NO_KIND)
        self.headings_rad = np.zeros((particles, capacity))
        self.heading_vars = np.ones((particles, capacity))
        self.seen = np.zeros((particles, capacity), dtype=np.int64)
        self._seen_at = np.zeros((particles, capacity), dtype=np.int64)
        self._scans = 0

    def near(
        self, position: FloatArray, radius_m: float, particle: int | None = None
    ) -> IntArray:
        """(N,) slots in use within that distance of (x, y), in any particle or in one."""
        rows = slice(None) if particle is None else slice(particle, particle + 1)
        square = ((self.points_m[rows] - position[:2]) ** 2).sum(axis=-1)
        is_near = (square < radius_m**2) & (self.kinds[rows] != NO_KIND)
        return np.flatnonzero(is_near.any(axis=0))

    def of(self, particle: int, slots: IntArray) -> Features:
        """One particle's landmarks in those slots, in the map frame."""
        return Features(
            points_m=self.points_m[particle, slots],
            covariances=self.covariances[particle, slots],
            kinds=self.kinds[particle, slots],
            headings_rad=self.headings_rad[particle, slots],
            heading_vars=self.heading_vars[particle, slots],
        )

    def associate(
        self, poses: FloatArray, sightings: Sightings, slots: IntArray, doubt: FloatArray
    ) -> IntArray:
        """(P, F) slot of each feature in each particle, or NEW, or UNCLEAR.

        `doubt` (3, 3) is the covariance of each particle's pose.
        """
        particles = len(poses)
        chosen = np.full((particles, len(sightings.polar)), NEW)
        if not len(slots):
            return chosen
        points = self.points_m[:, slots]
        innovations = _innovations(
            poses[:, None, None],
            points[:, None],
            self.covariances[:, slots][:, None],
            sightings.polar[:, None],
            sightings.covariances[:, None],
            doubt,
        )
        chi2 = innovations.chi2()  # (P, F, N)
        placed = transform_points(poses, sightings.features.points_m)
        distance = np.hypot(*np.moveaxis(placed[:, :, None] - points[:, None], -1, 0))
        features = sightings.features
        other = self.kinds[:, slots][:, None] != features.kinds[:, None]
        headings = features.headings_rad + poses[:, 2, None]
        turn = wrap_rad(headings[..., None] - self.headings_rad[:, slots][:, None])
        turn_var = features.heading_vars[:, None] + self.heading_vars[:, slots][:, None]
        other |= turn**2 > TURN_CHI2 * (turn_var + doubt[2, 2] + TURN_STD_RAD**2)
        chi2[other] = np.inf
        distance[other] = np.inf
        is_apart = (chi2.min(axis=2) > APART_CHI2) & (distance.min(axis=2) > APART_M)
        nearest = np.where(is_apart, 0.0, chi2.min(axis=2)).mean(axis=0)
        rows = np.arange(particles)
        for feature in np.argsort(
            nearest, kind="stable"
        ):  # one after another: a landmark is given to one feature only
            best = chi2[:, feature].argmin(axis=1)
            is_same = chi2[rows, feature, best] < GATE_CHI2
            chosen[:, feature] = np.where(
                is_same, slots[best], np.where(is_apart[:, feature], NEW, UNCLEAR)
            )
            chi2[rows[is_same], :, best[is_same]] = np.inf
        return chosen

    def innovations(
        self, poses: FloatArray, sightings: Sightings, chosen: IntArray
    ) -> Innovations:
        """Innovations (P, F) of the chosen landmarks; meaningless where none was chosen."""
        rows = np.arange(len(poses))[:, None]
        return _innovations(
            poses[:, None],
            self.points_m[rows, chosen],
            self.covariances[rows, chosen],
            sightings.polar,
            sightings.covariances,
            np.zeros((3, 3)),
        )

    def turns(
        self, poses: FloatArray, sightings: Sightings, chosen: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """(P, F) how far each pose should turn for a landmark's heading, and the variance."""
        rows = np.arange(len(poses))[:, None]
        seen_rad = sightings.features.headings_rad + poses[:, 2, None]
        turn = wrap_rad(self.headings_rad[rows, chosen] - seen_rad)
        return turn, sightings.features.heading_vars + self.heading_vars[rows, chosen]

    def learn(
        self, poses: FloatArray, sightings: Sightings, chosen: IntArray, doubt: FloatArray
    ) -> None:
        """Update the chosen landmarks, begin the new ones."""
        self._scans += 1
        particle, feature = np.nonzero(chosen >= 0)
        slot = chosen[particle, feature]
        covariance = self.covariances[particle, slot]
        innovations = _innovations(
            poses[particle],
            self.points_m[particle, slot],
            covariance,
            sightings.polar[feature],
            sightings.covariances[feature],
            doubt,
        )
        H = innovations.by_landmark
        K = covariance @ H.swapaxes(1, 2) @ np.linalg.inv(innovations.covariance)
        self.points_m[particle, slot] += (K @ innovations.error[..., None])[..., 0]
        smaller = covariance - K @ H @ covariance
        smaller = 0.5 * (smaller + smaller.swapaxes(1, 2)) + np.eye(2) * VARIANCE_FLOOR_M2 * 0.1
        self.covariances[particle, slot] = smaller
        turn, turn_var = (
            of_all[particle, feature] for of_all in self.turns(poses, sightings, chosen)
        )
        gain = self.heading_vars[particle, slot] / (turn_var + doubt[2, 2])
        self.headings_rad[particle, slot] -= gain * turn
        self.heading_vars[particle, slot] *= 1.0 - gain
        self.seen[particle, slot] += 1
        self._seen_at[particle, slot] = self._scans
        is_chance = (self.seen < SEEN_OFTEN) & (self._scans - self._seen_at > PATIENCE)
        self.kinds[is_chance] = NO_KIND
        self.seen[is_chance] = 0
        self._begin(poses, sightings.features, chosen, doubt)

    def _begin(
        self, poses: FloatArray, features: Features, chosen: IntArray, doubt: FloatArray
    ) -> None:
        placed = transform_points(poses, features.points_m)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=1)
        for feature in np.flatnonzero((chosen == NEW).any(axis=0)):  # each takes its own slot
            rows = np.flatnonzero(chosen[:, feature] == NEW)
            worth = self.seen[rows] * (self._scans + 1) + self._seen_at[rows]
            slot = worth.argmin(axis=1)  # a free one, or else the least seen and oldest
            arm = placed[rows, feature] - poses[rows, :2]
            lever = np.zeros((len(rows), 2, 3))
            lever[:, 0, 0] = lever[:, 1, 1] = 1.0
            lever[:, 0, 2], lever[:, 1, 2] = -arm[:, 1], arm[:, 0]
            spread = turn[rows] @ features.covariances[feature] @ turn[rows].swapaxes(1, 2)
            self.points_m[rows, slot] = placed[rows, feature]
            self.covariances[rows, slot] = spread + lever @ doubt @ lever.swapaxes(1, 2)
            self.kinds[rows, slot] = features.kinds[feature]
            self.headings_rad[rows, slot] = features.headings_rad[feature] + poses[rows, 2]
            self.heading_vars[rows, slot] = features.heading_vars[feature] + doubt[2, 2]
            self.seen[rows, slot] = 1
            self._seen_at[rows, slot] = self._scans

    def take(self, particles: IntArray) -> None:
        """Resampled: particle i has now the map that `particles[i]` had."""
        for name in (
            *("points_m", "covariances", "kinds", "headings_rad", "heading_vars"),
            *("seen", "_seen_at"),
        ):
            setattr(self, name, getattr(self, name)[particles])

    def carry(self, new_from_old: FloatArray) -> None:
        """Move all maps by a rigid motion (3,)."""
        self.points_m = transform_points(new_from_old, self.points_m)
        c, s = np.cos(new_from_old[2]), np.sin(new_from_old[2])
        turn = np.array([[c, -s], [s, c]])
        self.covariances = turn @ self.covariances @ turn.T
        self.headings_rad = self.headings_rad + new_from_old[2]


def _innovations(
    poses: FloatArray,
    points_m: FloatArray,
    covariances: FloatArray,
    polar: FloatArray,
    noise: FloatArray,
    doubt: FloatArray,
) -> Innovations:
    """Of landmarks seen from poses, broadcast against one another; the paper's d and alpha."""
    dx, dy = points_m[..., 0] - poses[..., 0], points_m[..., 1] - poses[..., 1]
    distance = np.maximum(np.hypot(dx, dy), DISTANCE_MIN_M)
    c, s = dx / distance, dy / distance
    zero = np.zeros_like(c)
    by_landmark = np.stack(
        [np.stack([c, s], axis=-1), np.stack([-s / distance, c / distance], axis=-1)], axis=-2
    )
    by_pose = np.stack(
        [
            np.stack([-c, -s, zero], axis=-1),
            np.stack([s / distance, -c / distance, zero - 1.0], axis=-1),
        ],
        axis=-2,
    )
    expected_rad = np.arctan2(dy, dx) - poses[..., 2]
    error = np.stack(
        [polar[..., 0] - distance, wrap_rad(polar[..., 1] - expected_rad)], axis=-1
    )
    covariance = by_landmark @ covariances @ by_landmark.swapaxes(-1, -2) + noise
    if doubt.any():
        covariance = covariance + by_pose @ doubt @ by_pose.swapaxes(-1, -2)
    return Innovations(
        error=error, covariance=covariance, by_pose=by_pose, by_landmark=by_landmark
    )
