# SPDX-License-Identifier: MIT
"""The way back from a place that could not be located, half of the rest at a time.

In go the path that led there and the pose it began at; out come legs back, each a path of its
own. Half way, more of the map is seen than at the end, and more of the new than at the start.
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath

LEG_MIN_M = 0.5  # a shorter rest is gone in one leg


class Retreat:
    """One way back; after its last leg one is at `start`, and stays."""

    def __init__(self, path: PlannedPath, start: Pose2) -> None:
        self._points_m = path.points_m
        self._start = start
        self._heading_rad = float(path.headings_rad[-1])
        steps = np.hypot(*np.diff(path.points_m, axis=0).T)
        self._way_m = np.concatenate([[0.0], np.cumsum(steps)])
        self._at_m = float(self._way_m[-1])

    def next_leg(self) -> PlannedPath:
        """From where the last leg ended; looking as at the goal, at the start as there."""
        from_m, half_m = self._at_m, 0.5 * self._at_m
        self._at_m = half_m if half_m >= LEG_MIN_M else 0.0
        between = (self._way_m > self._at_m) & (self._way_m < from_m)
        along_m = np.array([from_m, *self._way_m[between][::-1], self._at_m])
        points_m = np.stack(
            [np.interp(along_m, self._way_m, self._points_m[:, axis]) for axis in (0, 1)],
            axis=-1,
        )
        heading_rad = self._heading_rad
        if self._at_m == 0.0:
            points_m[-1] = self._start.x_m, self._start.y_m
            heading_rad = self._start.heading_rad
        return PlannedPath(points_m=points_m, headings_rad=np.full(len(points_m), heading_rad))
