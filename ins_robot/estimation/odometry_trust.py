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
from ins_robot.geometry.pose2 import compose
from ins_robot.messages import REPEATED_UNKNOWN, MotionIncrement

FACTORS = np.geomspace(1.0, 81.0, 13)  # on the assumed variance
FIRST_WORTH = 5.0  # nats for each doubling by which another one must be likelier than the first
MEMORY = 300.0  # scans
TAIL_DOF = 4.0  # Student's t: some scans are laid wrong
INFORMATION_MIN = np.diag([0.01, 0.01, 0.1])  # along a corridor there is none
MOVED_M = 0.02  # or radians: less tells nothing of how odometry errs
TURN_FACTOR_MIN = 4.0  # wheels slip in turns, now and then: what straight ways do not show
ANEW_M = 2.0  # along a way so long, or a turn of so many radians, odometry errs anew


@dataclass(frozen=True, slots=True)
class Innovation:
    """Where a scan alone was laid against where the motion had led: `off` (3,).

    `covariance` (3, 3) is what it would be off by, were the motion known. Both in the frame of
    the motion: the base before it.
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
        c, s = np.cos(before[2]), np.sin(before[2])
        dx, dy, turn = laid - led
        off = np.array([c * dx + s * dy, c * dy - s * dx, wrap_rad(float(turn))])
        known = covariance + np.asarray(np.linalg.inv(information), np.float64)
        return Innovation(off, turned(known, -float(before[2])))


class OdometryTrust:
    """Likelihood of each factor; motions with the one that is best."""

    def __init__(self) -> None:
        self._first = -FIRST_WORTH * np.abs(np.log2(FACTORS / REPEATED_UNKNOWN))
        self._learned = np.zeros(len(FACTORS))

    @property
    def factor(self) -> float:
        """The likeliest one."""
        return float(FACTORS[np.argmax(self._first + self._learned)])

    def expect(self, motion: MotionIncrement) -> MotionIncrement:
        """The motion, worth less against a scan by the factor; a short one, for it repeats."""
        factor = max(self.factor, min(ANEW_M / max(_way(motion), 1e-6), motion.repeated))
        widths = np.array([1.0, 1.0, np.sqrt(max(1.0, TURN_FACTOR_MIN / factor))])
        covariance = motion.covariance * np.outer(widths, widths)
        return replace(motion, repeated=factor, covariance=covariance)

    def learn(self, motion: MotionIncrement, innovation: Innovation | None) -> None:
        """Take in what a scan said of a motion, if anything; who stands errs in nothing."""
        if innovation is None or _way(motion) < MOVED_M:
            return
        off = innovation.off
        total = innovation.covariance + FACTORS[:, None, None] * motion.covariance
        chi2 = np.einsum("i,fij,j->f", off, np.linalg.inv(total), off)
        tail = 0.5 * (TAIL_DOF + len(off)) * np.log1p(chi2 / TAIL_DOF)
        self._learned *= 1.0 - 1.0 / MEMORY
        self._learned -= tail + 0.5 * np.linalg.slogdet(total)[1]


def _way(motion: MotionIncrement) -> float:
    """Metres driven plus radians turned."""
    delta = motion.delta
    return float(np.hypot(delta.x_m, delta.y_m)) + abs(delta.heading_rad)
