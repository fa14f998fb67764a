# SPDX-License-Identifier: MIT
"""Where the robot was, for scans that ask later, and how sure the way between two instants is.

Each row holds a pose and running sums of the errors each step may have made. An error in
heading made at p_k moves the end of the way by a lever p_end - p_k; expanded, that needs only
sums of w, w p and w p p' (w: heading variance of a step), so the covariance between any two
stamps costs two look-ups, however long the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import MotionIncrement, VelocityCommand

ROWS = 37_500  # 12 minutes at 50 Hz; standing long counts a row a second
EXTRAPOLATE_MAX_S = 0.1
REPEATED = 2.0  # gyro and wheels together err little the same way; docs/results.md
NOTHING_YET = "no wheel sample has come yet, so no pose is known"


class Row:
    """Columns of a row: a pose (odom_from_base, heading not wrapped), then sums over steps.

    Sums: position variance s (isotropic), heading variance w, its levers w x, w y, w xx, w xy,
    w yy, and the time t in which the heading relied on the gyro's bias, with t x, t y.
    """

    POSE = slice(0, 3)
    SIZE = 13


class BiasDoubt(NamedTuple):
    """On ways that lead past `at_s` the gyro's bias may be off, up to `until_s`."""

    at_s: float
    until_s: float
    std_radps: float


class PoseHistory:
    """Rows with increasing stamps, contiguous in memory: the older, the further apart.

    Nothing is forgotten altogether, however long the robot stands after its last scan.
    """

    def __init__(self, rows: int = ROWS) -> None:
        self._stamps_s = np.empty(rows)
        self._rows = np.empty((len(self._stamps_s), Row.SIZE))
        self._count = 0
        self._sums = [0.0] * (Row.SIZE - Row.POSE.stop)

    def __len__(self) -> int:
        return self._count

    def append(
        self,
        stamp_s: float,
        pose: tuple[float, float, float],
        *,
        position_var: float = 0.0,
        heading_var: float = 0.0,
        gyro_time_s: float = 0.0,
        replaces_last: bool = False,
    ) -> None:
        """Add (or put in place of the last) a pose and the variances of the step to it."""
        x, y, heading = pose
        s, w, t = self._sums, heading_var, gyro_time_s
        self._sums = s = [
            s[0] + position_var,
            s[1] + w,
            s[2] + w * x,
            s[3] + w * y,
            s[4] + w * x * x,
            s[5] + w * x * y,
            s[6] + w * y * y,
            s[7] + t,
            s[8] + t * x,
            s[9] + t * y,
        ]
        if self._count == len(self._stamps_s):
            self._thin()
        if replaces_last:
            self._count -= 1
        self._stamps_s[self._count] = stamp_s
        self._rows[self._count] = (x, y, heading, *s)
        self._count += 1

    def poses_at(self, stamps_s: FloatArray, twist: VelocityCommand) -> FloatArray:
        """(N, 3) poses at stamps (N,), heading wrapped.

        Linear between rows; `twist` carries on after the last row for 0.1 s at most; stamps
        outside get the nearest pose there is.
        """
        stamps_s = np.asarray(stamps_s, dtype=np.float64)
        poses = self._interpolate(stamps_s)
        ahead_s = np.clip(stamps_s - self._stamps_s[self._count - 1], 0.0, EXTRAPOLATE_MAX_S)
        if ahead_s.any():
            middle = poses[:, 2] + 0.5 * twist.yaw_rate_radps * ahead_s
            c, s = np.cos(middle), np.sin(middle)
            poses[:, 0] += ahead_s * (c * twist.vx_mps - s * twist.vy_mps)
            poses[:, 1] += ahead_s * (s * twist.vx_mps + c * twist.vy_mps)
            poses[:, 2] += ahead_s * twist.yaw_rate_radps
        poses[:, 2] = wrap_rad(poses[:, 2])
        return poses

    def increment(
        self, from_s: float, to_s: float, twist: VelocityCommand, doubts: Sequence[BiasDoubt]
    ) -> MotionIncrement:
        """Motion between two stamps with the covariance of what was added between them.

        Parameters
        ----------
        doubts : sequence of BiasDoubt
            Of the gyro's bias; each error is one number for all of its way.

        Raises
        ------
        StateError
            When `from_s` is older than the history, or later than `to_s`.
        """
        self._check(from_s, to_s)
        start, *sums_before = self._row_at(from_s, twist)
        end, *sums_after = self._row_at(to_s, twist)
        s, w, wx, wy, wxx, wxy, wyy, *_ = (
            after - before for before, after in zip(sums_before, sums_after, strict=True)
        )
        # Sums are taken about the origin of odom; x, y: the end of the way. Lever turned by 90
        # degrees: an error e in heading moves the end by e * (-dy, dx).
        x, y = end.x_m, end.y_m
        xx = s + w * y * y - 2.0 * y * wy + wyy
        yy = s + w * x * x - 2.0 * x * wx + wxx
        xy = x * wy + y * wx - w * x * y - wxy
        xh, yh = wy - w * y, w * x - wx
        hh = w
        for doubt in doubts:
            t, tx, ty = self._gyro_times(sums_before, min(doubt.until_s, to_s), twist)
            # one number: its effects add up before squaring
            v, bx, by = doubt.std_radps**2, ty - t * y, t * x - tx
            xx, yy, xy = xx + v * bx * bx, yy + v * by * by, xy + v * bx * by
            xh, yh, hh = xh + v * bx * t, yh + v * by * t, hh + v * t * t
        # From odom's axes into those of the base at the start.
        c, d = math.cos(start.heading_rad), math.sin(start.heading_rad)
        cross = c * d * (yy - xx) + (c * c - d * d) * xy
        to_x, to_y = c * xh + d * yh, c * yh - d * xh
        covariance = np.array(
            [
                [c * c * xx + 2.0 * c * d * xy + d * d * yy, cross, to_x],
                [cross, d * d * xx - 2.0 * c * d * xy + c * c * yy, to_y],
                [to_x, to_y, hh],
            ]
        )
        return MotionIncrement(
            from_stamp_s=from_s,
            to_stamp_s=to_s,
            delta=start.between(end),
            covariance=covariance,
            repeated=REPEATED,
        )

    def _gyro_times(
        self, sums_before: list[float], until_s: float, twist: VelocityCommand
    ) -> list[float]:
        """Time driven by the gyro since some sums, and its moments in x and y."""
        _, *sums = self._row_at(until_s, twist)
        return [
            after - before for before, after in zip(sums_before[-3:], sums[-3:], strict=True)
        ]

    def _thin(self) -> None:
        """Of the older half keep every other row, the first one always."""
        half = self._count // 2
        kept = np.concatenate([np.arange(0, half, 2), np.arange(half, self._count)])
        self._count = len(kept)
        self._stamps_s[: self._count] = self._stamps_s[kept]
        self._rows[: self._count] = self._rows[kept]

    def _check(self, from_s: float, to_s: float) -> None:
        if not self._count:
            raise StateError(NOTHING_YET)
        oldest_s = float(self._stamps_s[0])
        if from_s < oldest_s - EXTRAPOLATE_MAX_S:
            raise StateError(
                f"motion asked from {from_s:.3f} s, but the history begins at {oldest_s:.3f} s "
                f"({self._count} poses kept)"
            )
        if to_s < from_s:
            raise StateError(f"motion asked backwards, from {from_s:.3f} s to {to_s:.3f} s")

    def _row_at(
        self, stamp_s: float, twist: VelocityCommand
    ) -> tuple[Pose2, *tuple[float, ...]]:
        """Pose and sums at one stamp: `poses_at` in plain floats, for callers at 50 Hz."""
        last = self._count - 1
        after = int(np.searchsorted(self._stamps_s[: self._count], stamp_s))
        if after > last:
            x, y, heading, *sums = self._rows[last].tolist()
            ahead_s = min(stamp_s - float(self._stamps_s[last]), EXTRAPOLATE_MAX_S)
            middle = heading + 0.5 * twist.yaw_rate_radps * ahead_s
            c, s = math.cos(middle), math.sin(middle)
            x += ahead_s * (c * twist.vx_mps - s * twist.vy_mps)
            y += ahead_s * (s * twist.vx_mps + c * twist.vy_mps)
            heading += ahead_s * twist.yaw_rate_radps
        elif after == 0:
            x, y, heading, *sums = self._rows[0].tolist()
        else:
            begin_s, end_s = self._stamps_s[after - 1 : after + 1].tolist()
            share = (stamp_s - begin_s) / (end_s - begin_s)
            before_row, after_row = self._rows[after - 1 : after + 1].tolist()
            x, y, heading, *sums = (
                b + share * (a - b) for b, a in zip(before_row, after_row, strict=True)
            )
        return Pose2(x, y, wrap_rad(heading)), *sums

    def _interpolate(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) poses at `stamps_s`, linear between rows, the nearest row outside."""
        if not self._count:
            raise StateError(NOTHING_YET)
        known_s, rows = self._stamps_s[: self._count], self._rows[: self._count, Row.POSE]
        if self._count == 1:
            return np.repeat(rows, len(stamps_s), axis=0)
        after = np.clip(np.searchsorted(known_s, stamps_s), 1, self._count - 1)
        before = after - 1
        share = (stamps_s - known_s[before]) / (known_s[after] - known_s[before])
        share = np.clip(share, 0.0, 1.0)[:, None]
        interpolated: FloatArray = rows[before] + share * (rows[after] - rows[before])
        return interpolated
