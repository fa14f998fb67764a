# SPDX-License-Identifier: MIT
"""Lines fitted to windows of readings, all windows at once, and where two of them meet.

Total least squares by principal axes in closed form; sums over a window are differences of
running sums.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray

SINE_MIN = 1e-6  # of the angle between two lines: flatter ones are taken for this
READINGS_MIN = 3
LENGTH_MIN_M = 0.1
STD_MAX_M = 0.02
STD_MAX_RATIO = 1.5  # ... what their own noise explains


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFits:
    """K lines.

    Attributes
    ----------
    centres_m, directions : (K, 2)
        Middle of the readings and unit vector along them.
    var_m2 : (K,)
        Variance of one reading across the line; not less than its range noise.
    along_m2 : (K,)
        Sum of the squared distances of the readings from the middle.
    counts : (K,) int64
    is_good : (K,) bool
        Enough readings, long enough, and on a line.
    """

    centres_m: FloatArray
    directions: FloatArray
    var_m2: FloatArray
    along_m2: FloatArray
    counts: IntArray
    is_good: BoolArray

    @staticmethod
    def of_windows(
        points_m: FloatArray, range_var_m2: FloatArray, first: IntArray, last: IntArray
    ) -> LineFits:
        """Lines through readings `first` to `last` (K,), both included, of points (B, 2)."""
        x, y = points_m.T
        columns = np.stack([x, y, x * x, x * y, y * y, range_var_m2], axis=-1)
        sums = np.concatenate([np.zeros((1, 6)), np.cumsum(columns, axis=0)])
        counts = last - first + 1
        mx, my, xx, xy, yy, noise = ((sums[last + 1] - sums[first]) / counts[:, None]).T
        xx, xy, yy = xx - mx * mx, xy - mx * my, yy - my * my
        half_gap = np.sqrt((0.5 * (xx - yy)) ** 2 + xy**2)
        along = 0.5 * (xx + yy) + half_gap
        across = np.maximum(0.5 * (xx + yy) - half_gap, 0.0)
        across = across * counts / np.maximum(counts - 2, 1)
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        is_straight = across < (STD_MAX_RATIO**2) * noise + STD_MAX_M**2
        return LineFits(
            centres_m=np.stack([mx, my], axis=-1),
            directions=np.stack([np.cos(angle), np.sin(angle)], axis=-1),
            var_m2=np.maximum(across, noise),
            along_m2=np.maximum(along, 1e-9) * counts,
            counts=counts,
            is_good=(counts >= READINGS_MIN) & (12.0 * along > LENGTH_MIN_M**2) & is_straight,
        )

    def take(self, index: IntArray | BoolArray) -> LineFits:
        """A part of them."""
        return LineFits(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def or_else(self, is_self: BoolArray, other: LineFits) -> LineFits:
        """Row by row this line where `is_self` (K,), the other's elsewhere."""

        def pick(name: str) -> np.ndarray:
            mine, theirs = getattr(self, name), getattr(other, name)
            is_mine = is_self.reshape(-1, *[1] * (mine.ndim - 1))
            return np.asarray(np.where(is_mine, mine, theirs))

        return LineFits(**{f.name: pick(f.name) for f in fields(self)})

    @property
    def normals(self) -> FloatArray:
        """(K, 2) unit vectors across."""
        return np.stack([-self.directions[:, 1], self.directions[:, 0]], axis=-1)

    def distances_m(self, points_m: FloatArray) -> FloatArray:
        """(K,) signed distance of a point (K, 2) from each line."""
        distance: FloatArray = (self.normals * (points_m - self.centres_m)).sum(axis=1)
        return distance

    @property
    def heading_vars(self) -> FloatArray:
        """(K,) variance of the direction."""
        return self.var_m2 / self.along_m2

    def away_from(self, points_m: FloatArray) -> FloatArray:
        """(K, 2) each direction, from a point (K, 2) on the line towards its middle."""
        side = ((self.centres_m - points_m) * self.directions).sum(axis=1)
        return self.directions * np.where(side < 0.0, -1.0, 1.0)[:, None]

    def var_at(self, along_m: FloatArray) -> FloatArray:
        """(K,) variance of the line's place across, that far from its middle."""
        return self.var_m2 * (1.0 / self.counts + along_m**2 / self.along_m2)


def intersect(
    one: LineFits, other: LineFits, std_min_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Meeting points (K, 2) with covariances (K, 2, 2), and sine of the angle between (K,).

    Parallel lines meet far away; the caller looks at the sine.
    """
    a, b = one.directions, other.directions
    sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    safe = np.where(np.abs(sine) < SINE_MIN, SINE_MIN, sine)
    off = other.centres_m - one.centres_m
    at = (off[:, 0] * b[:, 1] - off[:, 1] * b[:, 0]) / safe
    points = one.centres_m + a * at[:, None]
    information = np.zeros((len(a), 2, 2))
    for line in (one, other):  # each line knows the point across itself
        along = ((points - line.centres_m) * line.directions).sum(axis=1)
        weight = 1.0 / (line.var_at(along) + std_min_m**2)
        information += weight[:, None, None] * (
            line.normals[:, :, None] * line.normals[:, None, :]
        )
    trace = np.trace(information, axis1=1, axis2=2)
    information += (1e-9 * trace)[:, None, None] * np.eye(
        2
    )  # parallel lines know one direction
    return points, np.asarray(np.linalg.inv(information), dtype=np.float64), sine
