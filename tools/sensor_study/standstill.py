# SPDX-License-Identifier: MIT
"""Turns of a range finder that stands: what repeating a reading shows of its error.

One `Standstill` comes from a recording or from the simulator; both are measured by the same
code. T turns, B beams.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ins_robot.geometry.angles import FloatArray

READS_SHARE_MIN = 0.8
"""A steady beam has a reading in at least this share of the turns."""
OUTLIER_STDS, OUTLIER_FLOOR_M = 5.0, 1.5e-3
"""Farther from the median than this many robust deviations: another surface, not noise."""


@dataclass(frozen=True)
class Standstill:
    """Readings of one place.

    `ranges_m` is (T, B), NaN where there is no reading; `is_open` (B,) tells the beams before
    which nothing of the robot itself stands.
    """

    name: str
    ranges_m: FloatArray
    is_open: np.ndarray

    @cached_property
    def _steady(self) -> tuple[FloatArray, FloatArray]:
        """Median ranges (N,) and standard deviations (N,) of the steady beams, outliers out."""
        is_steady = np.isfinite(self.ranges_m).mean(axis=0) >= READS_SHARE_MIN
        ranges_m = self.ranges_m[:, is_steady & self.is_open]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            median_m = np.nanmedian(ranges_m, axis=0)
            off_m = np.abs(ranges_m - median_m)
            spread_m = np.maximum(1.4826 * np.nanmedian(off_m, axis=0), OUTLIER_FLOOR_M)
            kept_m = np.where(off_m > OUTLIER_STDS * spread_m, np.nan, ranges_m)
            return median_m, np.nanstd(kept_m, axis=0, ddof=1)

    @property
    def steady_ranges_m(self) -> FloatArray:
        """(N,) median range of each steady beam."""
        return self._steady[0]

    @property
    def steady_stds_m(self) -> FloatArray:
        """(N,) standard deviation of each steady beam's readings."""
        return self._steady[1]

    def repeated_share(self, low_m: float, high_m: float) -> FloatArray:
        """(N,) for beams within these ranges: share of readings equal to the one before."""
        steps = np.diff(self.ranges_m[:, self._between(low_m, high_m)], axis=0)
        is_pair = np.isfinite(steps)
        return (is_pair & (steps == 0.0)).sum(axis=0) / np.maximum(1, is_pair.sum(axis=0))

    def lost_share_of_seen(self) -> FloatArray:
        """(N,) for beams with a reading in most turns: the share of turns without."""
        share = np.isfinite(self.ranges_m[:, self.is_open]).mean(axis=0)
        return 1.0 - share[share > 0.5]

    def _between(self, low_m: float, high_m: float) -> np.ndarray:
        share = np.isfinite(self.ranges_m).mean(axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            median_m = np.nanmedian(self.ranges_m, axis=0)
        return (
            (share >= READS_SHARE_MIN)
            & (median_m >= low_m)
            & (median_m < high_m)
            & self.is_open
        )


def lost_run_lengths(ranges_m: FloatArray, is_open: np.ndarray) -> FloatArray:
    """Lengths of the runs of open beams without a reading, over all turns (T, B)."""
    is_lost = ~np.isfinite(ranges_m[:, is_open])
    lengths: list[np.ndarray] = []
    for row in is_lost:  # a few hundred turns
        ends = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        lengths.append(ends[1::2] - ends[::2])
    return np.concatenate(lengths).astype(float)
