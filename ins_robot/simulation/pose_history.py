# SPDX-License-Identifier: MIT
"""Where the body really was, at any time of the run.

Grows by 32 bytes a step while the body moves; standing still costs nothing.
"""

from __future__ import annotations

from array import array

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad

_TAIL = 64
"""Newest entries looked at first: more than half a second of driving."""


class PoseHistory:
    """Stamped poses (x_m, y_m, unwrapped heading_rad), looked up by interpolation."""

    def __init__(self, stamp_s: float, pose: tuple[float, float, float]) -> None:
        self._stamps = array("d", [stamp_s])
        self._poses = array("d", pose)
        self._stands = False
        self._last = pose

    def append(self, stamp_s: float, pose: tuple[float, float, float]) -> None:
        """Add a pose; stamps must ascend."""
        if pose == self._last:
            if self._stands:  # push the end of the rest on
                self._stamps[-1] = stamp_s
                return
            self._stands = True
        else:
            self._stands = False
        self._last = pose
        self._stamps.append(stamp_s)
        self._poses.extend(pose)

    def __len__(self) -> int:
        return len(self._stamps)

    def at(self, stamps_s: FloatArray, twist_world: tuple[float, float, float]) -> FloatArray:
        """(N, 3) poses at the stamps (N,), headings wrapped.

        Past the newest entry the body is taken to go on with `twist_world` (vx, vy, yaw rate,
        world frame): devices that live on other ticks look a few milliseconds ahead. Before the
        first entry it stands there.
        """
        oldest_s = float(stamps_s.min()) if stamps_s.size else self._stamps[-1]
        if self._stands and oldest_s >= self._stamps[-2]:
            x, y, heading = self._last
            return np.tile((x, y, wrap_rad(heading)), (stamps_s.size, 1))
        tail = self._tail_for(oldest_s)
        known = np.array(self._stamps[tail:])
        poses = np.array(self._poses[3 * tail :]).reshape(-1, 3)
        ahead = np.maximum(stamps_s - known[-1], 0.0)
        found = np.empty((stamps_s.size, 3))
        for axis in range(3):  # three columns
            found[:, axis] = np.interp(stamps_s, known, poses[:, axis])
            found[:, axis] += ahead * twist_world[axis]
        found[:, 2] = wrap_rad(found[:, 2])
        return found

    def _tail_for(self, oldest_s: float) -> int:
        """Index from which on the entries cover `oldest_s`."""
        tail = max(0, len(self._stamps) - _TAIL)
        return tail if self._stamps[tail] <= oldest_s else 0
