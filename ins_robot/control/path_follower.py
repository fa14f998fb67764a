# SPDX-License-Identifier: MIT
"""The state-feedback linearising controller that tracks a reference trajectory.

The omni base's kinematics are square and invertible, so u = R(theta)^T (x'_ref + K e) turns the
error into e' = -K e in x, y and heading independently (Li & Zell 2007); the wheels' inverse
kinematics follow in `kinematics`. The reference waits for a robot that was held up.
"""

from __future__ import annotations

import math
from enum import StrEnum

from ins_robot.config import ControlConfig
from ins_robot.control.reference import ReferenceTrajectory
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath, VelocityCommand

LAG_FULL_SPEED_M = 0.05  # position error up to which the reference runs at full speed
LAG_STOP_M = 0.15  # and from which it stands
HALF_S = 0.5
PROGRESS_S = 0.1  # less time left by this much is progress


class Following(StrEnum):
    """How far the follower is."""

    ON_THE_WAY = "on the way"
    ARRIVED = "arrived"
    STUCK = "stuck"
    BLOCKED = "blocked"


class PathFollower:
    """Tracks one path from where it was made until arrival or for want of progress."""

    def __init__(self, path: PlannedPath, config: ControlConfig) -> None:
        self._config = config
        self._reference = ReferenceTrajectory(path, config)
        self._reference_s = 0.0
        self._still_s = 0.0
        self._best_left_s = math.inf
        self.verdict = Following.ON_THE_WAY

    def points_ahead(self, horizon_s: float) -> list[tuple[float, float]]:
        """Places the reference will be at within `horizon_s`, every half second."""
        steps = int(min(horizon_s, self.duration_s - self._reference_s) / HALF_S) + 1
        ahead = [self._reference.at(self._reference_s + HALF_S * i) for i in range(steps)]
        return [(reference.x_m, reference.y_m) for reference in ahead]

    @property
    def duration_s(self) -> float:
        """How long the undisturbed reference takes."""
        return self._reference.duration_s

    def step(self, pose: Pose2, dt_s: float) -> VelocityCommand:
        """Wanted velocity in the base frame for the robot at `pose` (the path's frame)."""
        ahead = self._reference.at(self._reference_s)
        lag_m = math.hypot(ahead.x_m - pose.x_m, ahead.y_m - pose.y_m)
        pace = min(1.0, max(0.0, (LAG_STOP_M - lag_m) / (LAG_STOP_M - LAG_FULL_SPEED_M)))
        self._reference_s += pace * dt_s
        wanted = self._reference.at(self._reference_s)
        ex, ey = wanted.x_m - pose.x_m, wanted.y_m - pose.y_m
        heading_error = wrap_rad(wanted.heading_rad - pose.heading_rad)
        self._judge(pose, dt_s)
        if self.verdict is not Following.ON_THE_WAY:
            return VelocityCommand()
        gain = self._config.position_gain_per_s
        vx = pace * wanted.vx_mps + gain * ex
        vy = pace * wanted.vy_mps + gain * ey
        c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
        return VelocityCommand(
            vx_mps=c * vx + s * vy,
            vy_mps=-s * vx + c * vy,
            yaw_rate_radps=pace * wanted.yaw_rate_radps
            + self._config.heading_gain_per_s * heading_error,
        )

    def _judge(self, pose: Pose2, dt_s: float) -> None:
        end = self._reference.end
        off_m = math.hypot(end.x_m - pose.x_m, end.y_m - pose.y_m)
        off_rad = abs(wrap_rad(end.heading_rad - pose.heading_rad))
        time_left_s = max(0.0, self._reference.duration_s - self._reference_s)
        if (
            time_left_s == 0.0
            and off_m <= self._config.position_tolerance_m
            and off_rad <= math.radians(self._config.heading_tolerance_deg)
        ):
            self.verdict = Following.ARRIVED
            return
        # The reference comes nearer its end, then the robot nearer the reference's end.
        left_s = (
            time_left_s + off_m / self._config.cruise_mps + off_rad / self._config.turn_radps
        )
        if left_s < self._best_left_s - PROGRESS_S:
            self._best_left_s = left_s
            self._still_s = 0.0
        else:
            self._still_s += dt_s
            if self._still_s > self._config.stuck_s:
                self.verdict = Following.STUCK
