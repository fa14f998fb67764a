# SPDX-License-Identifier: MIT
"""Where on a finished map, from nothing: several hypotheses over scans, and a verdict.

The first scans are tried everywhere (`map_fit`); what fits becomes a hypothesis. Hypotheses
move by the motion between scans, are refined and weighed by each scan, and merge when they
meet. One found late is carried back through the scans before it, so that all have been weighed
by the same evidence. Nothing is drawn at random: the same scans give the same verdict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ins_robot.estimation.map_fit import Beams, everywhere, judge, refine
from ins_robot.estimation.motion_model import chain
from ins_robot.estimation.resampling import normalise
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, compose, inverse
from ins_robot.mapping.distance_map import DistanceMap
from ins_robot.mapping.map_files import GridView
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.messages import LaserScan, MotionIncrement

BEAMS_MIN = 12  # a scan of fewer readings is passed over, its motion is not
CANDIDATES = 800  # of a search, refined
HYPOTHESES_MAX = 200
SEARCHED_SCANS = 3  # after these a search is made only where nothing fits any more
PAST_SCANS = 10  # how far a late candidate is carried back
FOUND_STD = np.array([0.2, 0.2, math.radians(4.0)])  # of a search: its lattice
MOTION_STD_FLOOR = np.array([0.03, 0.03, math.radians(1.5)])
MOTION_DOUBT = 2.0  # odometry errs the same way again and again
SAME_M, SAME_RAD = 0.3, math.radians(12.0)
HOPELESS = 25.0  # nats behind the best: dropped

SURE_SHARE = 0.99  # of the weight, to be located
SURE_FIT = 0.8  # of the last scan and of the last few: foreign maps seldom fit that well ...
SOON_FIT = 0.9  # ... but a small room may do so for a scan or two: of fewer than FIT_SCANS
SURE_STD_M = 0.15  # wider: a corridor without an end
SURE_SCANS = 2
FIT_SCANS = 5
LOST_FIT = 0.6  # where the best fits a scan less, it is begun again
RIVAL_SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """One place fits and no other does: map_from_base and its covariance (3, 3)."""

    pose: Pose2
    covariance: FloatArray
    fit_share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Ambiguous:
    """Several places fit, or one not yet surely: poses (K, 3) with weights (K,), best first."""

    poses: FloatArray
    weights: FloatArray
    fit_share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Lost:
    """No place of the map fits what is seen; the best fits that share of the readings.

    0: nothing was seen, the scan has next to no reading.
    """

    fit_share: float


Verdict = Located | Ambiguous | Lost


@dataclass(frozen=True, slots=True, kw_only=True)
class _Hypotheses:
    """P of them, best first, as of the last scan."""

    poses: FloatArray  # (P, 3)
    log_weights: FloatArray  # (P,)
    fit_shares: FloatArray  # (P,) share of fitting readings, of the last few scans
    last_fits: FloatArray  # (P,) and of the last one alone
    information: FloatArray  # (P, 3, 3) of the last scan

    def take(self, index: IntArray) -> _Hypotheses:
        return _Hypotheses(
            poses=self.poses[index],
            log_weights=self.log_weights[index],
            fit_shares=self.fit_shares[index],
            last_fits=self.last_fits[index],
            information=self.information[index],
        )

    def merged(self) -> _Hypotheses:
        """Best first; of those that have met only the best, and none without hope."""
        order = np.argsort(-self.log_weights, kind="stable")
        order = order[self.log_weights[order] > self.log_weights[order[0]] - HOPELESS]
        poses = self.poses[order]
        is_kept = np.ones(len(order), dtype=bool)
        for k in range(len(order)):  # each decision hangs on those before it
            if is_kept[k]:
                off = poses[k + 1 :] - poses[k]
                is_same = (np.hypot(off[:, 0], off[:, 1]) < SAME_M) & (
                    np.abs(wrap_rad(off[:, 2])) < SAME_RAD
                )
                is_kept[k + 1 :] &= ~is_same
        return self.take(order[is_kept][:HYPOTHESES_MAX])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Step:
    """A scan, and the motion that led to it."""

    beams: Beams
    motion: MotionIncrement


class GlobalLocalizer:
    """Takes scans and the motions between them; says after each where the robot is."""

    def __init__(self, grid: GridView, base_from_lrf: Pose2) -> None:
        self._field = DistanceMap(grid)
        self._base_from_lrf = base_from_lrf
        self._past: list[_Step] = []
        self._scans = 0
        self._unused: MotionIncrement | None = None
        self._hypotheses: _Hypotheses | None = None

    def step(self, scan: LaserScan, motion: MotionIncrement) -> Verdict:
        """Take in a scan and the motion since the last one (of the first it is not used)."""
        if self._unused is not None:
            motion = chain(self._unused, motion)
        beams = Beams.of(scan, self._base_from_lrf)
        if len(beams) < BEAMS_MIN:
            self._unused = motion
            return Lost(fit_share=0.0)
        now, self._unused = _Step(beams=beams, motion=motion), None
        self._scans += 1
        self._past = [*self._past, now][-PAST_SCANS:]
        followed = None if self._hypotheses is None else self._follow(self._hypotheses, now)
        if followed is None or followed.last_fits[0] < LOST_FIT:
            # carried off, or never right: what was seen before is no help
            self._past, self._scans = [now], 1
            followed = self._search()
        elif self._scans <= SEARCHED_SCANS:
            followed = _joined(followed, self._search())
        self._hypotheses = None if followed is None else followed.merged()
        return self._verdict(self._hypotheses)

    def _follow(self, hypotheses: _Hypotheses, now: _Step) -> _Hypotheses:
        predicted = compose(hypotheses.poses, now.motion.delta.as_array())
        seen = self._weighed(now.beams, predicted, _information(now.motion))
        change = seen.fit_shares - hypotheses.fit_shares
        return _Hypotheses(
            poses=seen.poses,
            log_weights=hypotheses.log_weights + seen.log_weights,
            fit_shares=hypotheses.fit_shares + change / min(self._scans, FIT_SCANS),
            last_fits=seen.last_fits,
            information=seen.information,
        ).merged()

    def _search(self) -> _Hypotheses | None:
        """The last scan tried everywhere; what was found, weighed by earlier scans as well."""
        beams = self._past[-1].beams
        lattice = everywhere(self._field, beams, CANDIDATES)
        if not len(lattice):
            return None
        prior = 1.0 / FOUND_STD**2
        refined = refine(self._field, beams, lattice, prior)
        found = self._weighed(beams, refined.poses, prior).merged()
        log_weights, fit_sums, then = found.log_weights, found.fit_shares, found.poses
        for later, earlier in pairwise(reversed(self._past)):
            then = compose(then, inverse(later.motion.delta.as_array()))
            seen = self._weighed(earlier.beams, then, _information(later.motion))
            then = seen.poses
            log_weights = log_weights + seen.log_weights
            fit_sums = fit_sums + seen.fit_shares
        return _Hypotheses(
            poses=found.poses,
            log_weights=log_weights,
            fit_shares=fit_sums / len(self._past),
            last_fits=found.last_fits,
            information=found.information,
        )

    def _weighed(self, beams: Beams, starts: FloatArray, prior: FloatArray) -> _Hypotheses:
        """Refined from `starts`; weighed by the scan and by how far it had to be moved."""
        refined = refine(self._field, beams, starts, prior)
        judged = judge(self._field, beams, refined.poses)
        off = refined.poses - starts
        off[:, 2] = wrap_rad(off[:, 2])
        return _Hypotheses(
            poses=refined.poses,
            log_weights=judged.log_likelihoods - 0.5 * off**2 @ prior,
            fit_shares=judged.fit_shares,
            last_fits=judged.fit_shares,
            information=refined.information,
        )

    def _verdict(self, hypotheses: _Hypotheses | None) -> Verdict:
        if hypotheses is None:
            return Lost(fit_share=0.0)
        fit_share = float(hypotheses.fit_shares[0])
        if fit_share < LOST_FIT:
            return Lost(fit_share=fit_share)
        weights = normalise(hypotheses.log_weights)
        covariance = np.linalg.inv(hypotheses.information[0])
        is_narrow = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1])) < SURE_STD_M
        enough = SURE_FIT if self._scans >= FIT_SCANS else SOON_FIT
        if (
            weights[0] >= SURE_SHARE
            and min(fit_share, hypotheses.last_fits[0]) >= enough
            and is_narrow
            and self._scans >= SURE_SCANS
        ):
            pose = Pose2.from_array(hypotheses.poses[0])
            return Located(pose=pose, covariance=covariance, fit_share=fit_share)
        is_rival = weights >= RIVAL_SHARE
        is_rival[0] = True
        return Ambiguous(
            poses=hypotheses.poses[is_rival], weights=weights[is_rival], fit_share=fit_share
        )


def _information(motion: MotionIncrement) -> FloatArray:
    """(3,) inverse variances along any axis of the map: the wider of along and across."""
    variances = np.diag(motion.covariance).copy()
    variances[:2] = variances[:2].max()
    return np.asarray(1.0 / (MOTION_DOUBT**2 * variances + MOTION_STD_FLOOR**2))


def _joined(one: _Hypotheses, other: _Hypotheses | None) -> _Hypotheses:
    if other is None:
        return one
    return _Hypotheses(
        poses=np.concatenate([one.poses, other.poses]),
        log_weights=np.concatenate([one.log_weights, other.log_weights]),
        fit_shares=np.concatenate([one.fit_shares, other.fit_shares]),
        last_fits=np.concatenate([one.last_fits, other.last_fits]),
        information=np.concatenate([one.information, other.information]),
    )
