# SPDX-License-Identifier: MIT
"""How far a log's odometry is off: learned from where the scans were laid.

Nobody says how good a log's odometry is, and what is assumed can be too cautious by far: where
a scan says little, along a corridor, it then drags the pose as it likes. In go the innovations;
out comes the factor on the assumed variance that makes them likeliest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ins_robot.estimation.motion_model import turned
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import between, compose
from ins_robot.messages import REPEATED_UNKNOWN, MotionIncrement

FACTORS = np.geomspace(1.0, 81.0, 13)  # on the assumed variance
FIRST_WORTH = 5.0  # nats for each doubling by which another one must be likelier than the first
MEMORY = 300.0  # scans
TAIL_DOF = 4.0  # Student's t: some scans are laid wrong
INFORMATION_MIN = np.diag([0.01, 0.01, 0.1])  # along a corridor there is none
ANEW_M = 2.0  # along a way so long, or a turn of so many radians, odometry errs anew


@dataclass(frozen=True, slots=True)
class Innovation:
    """Where a scan alone was laid, seen from where the motion had led: `off` (3,).

    `covariance` (3, 3) is what it would be off by, were the motion known.
    """

    off: FloatArray
    covariance: FloatArray

    @staticmethod
    def of(
        match: Alignment, before: FloatArray, covariance: FloatArray, motion: MotionIncrement
    ) -> Innovation:
        """Of a motion from `before` (3,), a pose known with `covariance` (3, 3), map frame."""
        information = match.information + INFORMATION_MIN
        laid = match.pose - np.linalg.solve(information, match.gradient)
        led = compose(before, motion.delta.as_array())
        off = between(led, laid)
        off[2] = wrap_rad(float(off[2]))
        known = covariance + np.asarray(np.linalg.inv(information), np.float64)
        return Innovation(off, turned(known, -float(led[2])))


class OdometryTrust:
    """Likelihood of each factor; motions with the one that is best."""

    def __init__(self) -> None:
        self._log_likelihoods = -FIRST_WORTH * np.abs(np.log2(FACTORS / REPEATED_UNKNOWN))

    @property
    def factor(self) -> float:
        """The likeliest one."""
        return float(FACTORS[np.argmax(self._log_likelihoods)])

    def expect(self, motion: MotionIncrement) -> MotionIncrement:
        """The motion, worth less against a scan by the factor; a short one, for it repeats."""
        delta = motion.delta
        way = np.hypot(delta.x_m, delta.y_m) + abs(delta.heading_rad)
        repeats = min(ANEW_M / max(float(way), 1e-6), motion.repeated)
        return replace(motion, repeated=max(self.factor, repeats))

    def learn(self, motion: MotionIncrement, innovation: Innovation | None) -> None:
        """Take in what a scan said of a motion, if anything."""
        if innovation is None:
            return
        off = innovation.off
        total = innovation.covariance + FACTORS[:, None, None] * motion.covariance
        chi2 = np.einsum("i,fij,j->f", off, np.linalg.inv(total), off)
        tail = 0.5 * (TAIL_DOF + len(off)) * np.log1p(chi2 / TAIL_DOF)
        self._log_likelihoods *= 1.0 - 1.0 / MEMORY
        self._log_likelihoods -= tail + 0.5 * np.linalg.slogdet(total)[1]
