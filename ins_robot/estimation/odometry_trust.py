# SPDX-License-Identifier: MIT
"""How far odometry is to be trusted against scans: learned from scans that know where they are.

Odometry errs the same way again and again: against a scan it is worth less than its variance
says, or a steady bias leaks into every match. But a platform whose steps are found true by scan
after scan may be believed where a scan finds the wrong thing, or nothing.
"""

from __future__ import annotations

import os

import numpy as np

from ins_robot.geometry.angles import FloatArray

DOUBT_MAX = 9.0  # times its variance: what is assumed of odometry nobody has tried
DOUBT_MIN = float(os.environ.get("DMIN", "1"))
MEASURED_TO_DOUBT = float(os.environ.get("KAPPA", "2"))  # errors repeat: next time as well, and by more
MEMORY = 0.98  # of what was learned stays from scan to scan
FIRST_SCANS = 5.0  # so many scans the first assumption weighs
SURPRISE_STDS = 4.0  # errors beyond this many deviations count as this many


class OdometryTrust:
    """Doubt of position and of heading, as factors on the variances that odometry states."""

    def __init__(self) -> None:
        self._doubt = np.full(2, DOUBT_MAX)
        self._error = np.zeros(2)
        self._stated = np.zeros(2)

    def doubted(self, covariance: FloatArray) -> FloatArray:
        """(3, 3) what a motion's covariance is taken for."""
        scale = np.sqrt(self._doubt[[0, 0, 1]])
        return np.asarray(covariance * scale[:, None] * scale)

    def learn(self, off: FloatArray, stated: FloatArray, other: FloatArray) -> None:
        """One more comparison.

        Parameters
        ----------
        off : (3,)
            Where a scan alone found the robot, from where the motion led.
        stated : (3, 3)
            Covariance of the motion as stated.
        other : (3, 3)
            Of everything else in `off`: the pose before, and the scan's own.
        """
        variance = np.diag(stated)
        rest = np.diag(other)
        expected = variance * self._doubt[[0, 0, 1]] + rest
        error = np.minimum(off**2, SURPRISE_STDS**2 * expected) - rest
        # a comparison tells the more, the less else there is in it
        weight = (variance / expected) ** 2 / variance
        weight /= self._doubt[[0, 0, 1]] ** -2 
        by_kind = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        self._error = MEMORY * self._error + by_kind @ (weight * error)
        self._stated = MEMORY * self._stated + by_kind @ (weight * variance)
        first = FIRST_SCANS
        measured = (first * DOUBT_MAX / MEASURED_TO_DOUBT + self._error) / (first + self._stated)
        self._doubt = np.clip(MEASURED_TO_DOUBT * measured, [DOUBT_MIN, float(os.environ.get("HMIN","9"))], DOUBT_MAX)
