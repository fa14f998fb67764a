# SPDX-License-Identifier: MIT
"""The scale of the wheels, out of the similarity transform's lambda (the paper's section 5.1).

Stations of the way as the odometry chained them, l, are fitted onto the same stations as scans
placed them, r: lambda R l + t = r. Scans have the LRF's scale, so lambda is what the wheels'
radius is to be multiplied by. The way is cut into stretches, each with an R and t of its own:
a drift of heading is no scale then, and the stretches' scatter tells lambda's deviation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.errors import DegenerateGeometryError
from ins_robot.estimation.similarity import fit_similarity
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import compose
from ins_robot.messages import MotionIncrement

STATION_M = 0.3  # way between stations
STRETCH_STATIONS = 8
STRETCHES_MIN = 4
STD_FLOOR = 0.002
SIGNIFICANT_STDS = 3.0
SIGNIFICANT_SHARE = 0.01  # less is within what a floor does to a wheel


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelScale:
    """What odometry is to be multiplied by, and the standard deviation of that."""

    scale: float
    std: float

    @property
    def is_off(self) -> bool:
        """Whether the wheels are surely not as configured."""
        off = abs(self.scale - 1.0)
        return off > max(SIGNIFICANT_STDS * self.std, SIGNIFICANT_SHARE)

    @property
    def advice(self) -> str:
        """One sentence: what to do about it, or that there is nothing to do."""
        if not self.is_off:
            return f"wheels agree with the scans: scale {self.scale:.3f} +- {self.std:.3f}"
        longer = "longer" if self.scale < 1.0 else "shorter"
        return (
            f"the wheels report ways {abs(1.0 / self.scale - 1.0):.1%} {longer} than the scans "
            f"(scale {self.scale:.3f} +- {self.std:.3f}): multiply wheels.radius_m by "
            f"{self.scale:.3f}"
        )

    def notes(self) -> dict[str, float | str]:
        """For summary.json."""
        return {
            "wheel_scale": round(self.scale, 4),
            "wheel_scale_std": round(self.std, 4),
            "wheel_scale_advice": self.advice,
        }


class WheelScaleMeter:
    """Collects stations and fits stretch after stretch."""

    def __init__(self) -> None:
        self._odometry = np.zeros(3)
        self._way_m = 0.0
        self._l: list[FloatArray] = []
        self._r: list[FloatArray] = []
        self._scales: list[float] = []

    def moved(self, motion: MotionIncrement) -> None:
        """The odometry went on."""
        self._odometry = compose(self._odometry, motion.delta.as_array())
        self._way_m += math.hypot(motion.delta.x_m, motion.delta.y_m)

    def located(self, pose: FloatArray) -> None:
        """A scan corrected the pose to this, map_from_base (3,)."""
        if self._l and self._way_m < STATION_M:
            return
        self._way_m = 0.0
        self._l.append(self._odometry[:2].copy())
        self._r.append(pose[:2].copy())
        if len(self._l) == STRETCH_STATIONS:
            self._close()

    def interrupt(self) -> None:
        """The map moved under the robot: stations before and after do not fit together."""
        self._l, self._r = [], []

    def value(self) -> WheelScale | None:
        """The scale so far; None before there are stretches enough."""
        count = len(self._scales)
        if count < STRETCHES_MIN:
            return None
        scales = np.array(self._scales)
        middle = float(np.median(scales))
        spread = 1.4826 * float(np.median(np.abs(scales - middle)))
        # the median of Gaussian values errs 1.25 times as much as their mean
        std = 1.2533 * spread / math.sqrt(count)
        return WheelScale(scale=middle, std=math.hypot(std, STD_FLOOR))

    def _close(self) -> None:
        """Fit the stretch; the next one begins where it ends."""
        try:
            fit = fit_similarity(np.array(self._l), np.array(self._r))
            self._scales.append(fit.transform.scale)
        except DegenerateGeometryError:
            pass  # a stretch on the spot says nothing
        self._l, self._r = self._l[-1:], self._r[-1:]
