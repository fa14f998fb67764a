# SPDX-License-Identifier: MIT
"""Where the robot was, for scans that ask later, and how sure the way between two instants is.

Each row holds a pose and running sums of the errors each step may have made. An error in
heading made at p_k moves the end of the way by a lever p_end - p_k; expanded, that needs only
sums of w, w p and w p p' (w: heading variance of a step), so the covariance between any two
stamps costs two look-ups, however long the way.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import MotionIncrement, VelocityCommand

ROWS = 30_000  # 10 minutes at 50 Hz; standing long counts a row a second
EXTRAPOLATE_MAX_S = 0.1


class Row:
    """Columns of a row: a pose (odom_from_base, heading not wrapped), then sums over steps."""

    POSE = slice(0, 3)
    POSITION_VAR = 3  # isotropic position variance
    HEADING_VAR = 4  # w
    LEVER = slice(5, 7)  # w x, w y
    LEVER_SQUARES = slice(7, 10)  # w xx, w xy, w yy
    GYRO_TIME = 10  # time the heading relied on the gyro's bias
    GYRO_LEVER = slice(11, 13)  # that time times x, y
    SIZE = 13


class PoseHistory:
    """A ring of rows with increasing stamps, contiguous in memory."""

    def __init__(self, rows: int = ROWS) -> None:
        self._rows_kept = rows
        self._stamps_s = np.empty(rows + rows // 4 + 1)
        self._rows = np.empty((len(self._stamps_s), Row.SIZE))
        self._count = 0
        self._sums = [0.0] * (Row.SIZE - Row.POSITION_VAR)

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
            kept = slice(self._count - self._rows_kept, self._count)
            self._stamps_s[: self._rows_kept] = self._stamps_s[kept]
            self._rows[: self._rows_kept] = self._rows[kept]
            self._count = self._rows_kept
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
        poses = self._interpolate(stamps_s, Row.POSE)
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
        self, from_s: float, to_s: float, twist: VelocityCommand, gyro_bias_var: float
    ) -> MotionIncrement:
        """Motion between two stamps with the covariance of what was added between them.

        Raises
        ------
        StateError
            When `from_s` is older than the history, or later than `to_s`.
        """
        stamps_s = np.array([from_s, to_s])
        self._check(from_s, to_s)
        poses = self.poses_at(stamps_s, twist)
        sums = self._interpolate(stamps_s, slice(0, Row.SIZE))
        added = sums[1] - sums[0]
        w, t = float(added[Row.HEADING_VAR]), float(added[Row.GYRO_TIME])
        # Sums are taken about the origin of odom; x, y: the end of the way.
        x, y = float(poses[1, 0]), float(poses[1, 1])
        wx, wy = added[Row.LEVER].tolist()
        wxx, wxy, wyy = added[Row.LEVER_SQUARES].tolist()
        tx, ty = added[Row.GYRO_LEVER].tolist()
        # Lever turned by 90 degrees: an error e in heading moves the end by e * (-dy, dx).
        covariance = np.diag([added[Row.POSITION_VAR]] * 2 + [w])
        covariance[0, 0] += w * y * y - 2.0 * y * wy + wyy
        covariance[1, 1] += w * x * x - 2.0 * x * wx + wxx
        covariance[0, 1] -= w * x * y - x * wy - y * wx + wxy
        covariance[0, 2], covariance[1, 2] = wy - w * y, w * x - wx
        covariance[1, 0] = covariance[0, 1]
        covariance[2, :2] = covariance[:2, 2]
        # The bias error is one number for the whole way, so its effects add up before squaring.
        bias_effect = np.array([ty - t * y, t * x - tx, t])
        covariance += gyro_bias_var * np.outer(bias_effect, bias_effect)
        start = Pose2.from_array(poses[0])
        c, s = math.cos(start.heading_rad), math.sin(start.heading_rad)
        base_from_odom = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return MotionIncrement(
            from_stamp_s=from_s,
            to_stamp_s=to_s,
            delta=start.between(Pose2.from_array(poses[1])),
            covariance=base_from_odom @ covariance @ base_from_odom.T,
        )

    def _check(self, from_s: float, to_s: float) -> None:
        oldest_s = float(self._stamps_s[0])
        if from_s < oldest_s - EXTRAPOLATE_MAX_S:
            raise StateError(
                f"motion asked from {from_s:.3f} s, but the history begins at {oldest_s:.3f} s "
                f"({self._count} poses kept); ask sooner"
            )
        if to_s < from_s:
            raise StateError(f"motion asked backwards, from {from_s:.3f} s to {to_s:.3f} s")

    def _interpolate(self, stamps_s: FloatArray, columns: slice) -> FloatArray:
        """(N, C) columns of the rows at `stamps_s`, linear between, the nearest row outside."""
        if not self._count:
            raise StateError("no wheel sample has come yet, so no pose is known")
        known_s, rows = self._stamps_s[: self._count], self._rows[: self._count, columns]
        if self._count == 1:
            return np.repeat(rows, len(stamps_s), axis=0)
        after = np.clip(np.searchsorted(known_s, stamps_s), 1, self._count - 1)
        before = after - 1
        share = (stamps_s - known_s[before]) / (known_s[after] - known_s[before])
        share = np.clip(share, 0.0, 1.0)[:, None]
        interpolated: FloatArray = rows[before] + share * (rows[after] - rows[before])
        return interpolated
