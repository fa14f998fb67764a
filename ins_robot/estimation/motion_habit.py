# SPDX-License-Identifier: MIT
"""How a robot without odometry is likely to move next: much as it did lately.

Logs are often thinned by way and turn, so that what happened per scan tells more than what
may happen per second. Only the way is guessed; it may turn to anywhere at any time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import MotionIncrement

MEMORY = 20  # scans
SCANS_MIN = 5
DOUBT = 4.0  # of the variance: the next step is not like the last ones
WAY_STD_M = 0.15  # it may start, stop or go back


class MotionHabit:
    """Ways (dx, dy) between the last scans; the next one as a motion."""

    def __init__(self) -> None:
        self._ways_m: list[FloatArray] = []

    def learn(self, delta: Pose2) -> None:
        """Take in a motion between two scans, as it turned out to have been."""
        self._ways_m = [*self._ways_m, delta.as_array()[:2]][-MEMORY:]

    def expect(self, motion: MotionIncrement) -> MotionIncrement:
        """The motion to the next scan: `motion` where nothing is known, and its heading."""
        if len(self._ways_m) < SCANS_MIN:
            return motion
        ways_m = np.array(self._ways_m)
        x_m, y_m = ways_m.mean(axis=0)
        covariance = np.diag(np.diag(motion.covariance))
        covariance[:2, :2] = DOUBT * np.cov(ways_m.T) + WAY_STD_M**2 * np.eye(2)
        delta = Pose2(float(x_m), float(y_m), motion.delta.heading_rad)
        return replace(motion, delta=delta, covariance=covariance)
