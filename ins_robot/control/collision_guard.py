# SPDX-License-Identifier: MIT
"""The last word on every velocity: slower, or not at all, towards what is known to be there.

It knows points on everything solid that was seen. It looks as far ahead as braking takes.
Moving away from an obstacle is always allowed, so a robot found too near a wall can leave it.
Near obstacles it slows the robot down, whichever way it goes: what is near is what is not fully
known yet. What leads into an obstacle at a slant slides along it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.spatial import cKDTree

from ins_robot.config import ControlConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import VelocityCommand

REACTION_S = 0.15  # motor lag and one tick
CREEP_MPS = 0.06  # however near, this fast is safe
CREEP_MARGIN_M = 0.01  # what a creeping body keeps: the noise of the nearest readings
STANDING_MPS = 1e-3
ASIDE = 0.3  # slope at which it moves away from what it slides along
SLIDE_MIN = 0.3  # less than this share of the way wanted is not worth sliding for
SCALES = (1.0, 0.6, 0.3)


class CollisionGuard:
    """Slows or refuses a velocity that would end in a known obstacle."""

    def __init__(self, config: ControlConfig, robot_radius_m: float) -> None:
        self._radius_m = robot_radius_m
        self._keep_m = robot_radius_m + config.guard_margin_m
        self._brake_mps2 = config.accel_mps2
        self._time_s = config.guard_time_s
        self._creep_keep_m = robot_radius_m + min(CREEP_MARGIN_M, config.guard_margin_m)
        self._walls: cKDTree | None = None

    def observe(self, walls: cKDTree) -> None:
        """Replace what is known of the obstacles: points (N, 2) on them, map frame."""
        self._walls = walls

    def apply(self, pose: Pose2, wanted: VelocityCommand) -> tuple[VelocityCommand, bool]:
        """The velocity allowed at `pose` (map frame), and whether it differs."""
        speed = math.hypot(wanted.vx_mps, wanted.vy_mps)
        if self._walls is None or self._walls.n == 0 or speed < STANDING_MPS:
            return wanted, False
        c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
        ux = (c * wanted.vx_mps - s * wanted.vy_mps) / speed
        uy = (s * wanted.vx_mps + c * wanted.vy_mps) / speed
        here_m, nearest = self._walls.query((pose.x_m, pose.y_m))
        here_m = max(float(here_m), 1e-6)
        pace_mps = min(speed, self._near_speed_mps(here_m))
        for scale in SCALES:
            if self._is_safe(pose, ux, uy, scale * pace_mps, here_m):
                return _scaled(wanted, scale * pace_mps / speed), scale < 1.0
        wall_x, wall_y = self._walls.data[nearest]
        nx, ny = (pose.x_m - wall_x) / here_m, (pose.y_m - wall_y) / here_m
        share, ax, ay = _aside(ux, uy, nx, ny)
        creep_mps = share * min(speed, CREEP_MPS)
        if share > SLIDE_MIN and self._is_safe(pose, ax, ay, creep_mps, here_m):
            vx, vy = creep_mps * (c * ax + s * ay), creep_mps * (c * ay - s * ax)
            yaw_rate = wanted.yaw_rate_radps
            return VelocityCommand(vx_mps=vx, vy_mps=vy, yaw_rate_radps=yaw_rate), True
        return VelocityCommand(yaw_rate_radps=wanted.yaw_rate_radps), True

    def _is_safe(
        self, pose: Pose2, ux: float, uy: float, speed_mps: float, here_m: float
    ) -> bool:
        """Whether the body may move that way (unit vector, map frame) that fast."""
        ahead_m = self._stopping_m(speed_mps)
        there_m = self._room_m(pose.x_m + ux * ahead_m, pose.y_m + uy * ahead_m)
        # At a crawl the margin may be used up: what the planner chose must let us through.
        keep_m = self._creep_keep_m if speed_mps <= CREEP_MPS else self._keep_m
        return there_m >= min(keep_m, here_m)

    def clearance_m(self, pose: Pose2) -> float:
        """From the body at `pose` to the nearest known obstacle; infinite without one."""
        return self._room_m(pose.x_m, pose.y_m) - self._radius_m

    def _room_m(self, x_m: float, y_m: float) -> float:
        """From a place to the nearest known surface."""
        if self._walls is None:
            return math.inf
        return float(self._walls.query((x_m, y_m))[0])

    def _near_speed_mps(self, here_m: float) -> float:
        """Fastest speed this near to an obstacle: distance over `control.guard_time_s`."""
        if self._time_s == 0.0:
            return math.inf
        return max(CREEP_MPS, (here_m - self._radius_m) / self._time_s)

    def blocks(self, here: tuple[float, float], points: Sequence[tuple[float, float]]) -> bool:
        """True when a body at one of `points` would touch what is known, and does not here."""
        if self._walls is None or not points:
            return False
        touching_m = min(self._creep_keep_m, self._room_m(*here))
        room_m, _ = self._walls.query(points)
        return bool((room_m < touching_m).any())

    def _stopping_m(self, speed_mps: float) -> float:
        return speed_mps * REACTION_S + speed_mps**2 / (2.0 * self._brake_mps2)


def _aside(ux: float, uy: float, nx: float, ny: float) -> tuple[float, float, float]:
    """What of a direction runs along an obstacle with that normal: how much, and where to."""
    along = uy * nx - ux * ny
    turn = math.copysign(1.0, along)
    ax, ay = -turn * ny + ASIDE * nx, turn * nx + ASIDE * ny
    length = math.hypot(ax, ay)
    return abs(along), ax / length, ay / length


class NoGuard:
    """For `control.guard = false`: lets everything pass."""

    def observe(self, walls: cKDTree) -> None:
        """Nothing to know."""

    def apply(self, pose: Pose2, wanted: VelocityCommand) -> tuple[VelocityCommand, bool]:
        """The wanted velocity as it is."""
        return wanted, False

    def clearance_m(self, pose: Pose2) -> float:
        """Nothing is known to be anywhere."""
        return math.inf

    def blocks(self, here: tuple[float, float], points: Sequence[tuple[float, float]]) -> bool:
        """Nothing is known to be there."""
        return False


def _scaled(velocity: VelocityCommand, scale: float) -> VelocityCommand:
    return VelocityCommand(
        vx_mps=scale * velocity.vx_mps,
        vy_mps=scale * velocity.vy_mps,
        yaw_rate_radps=velocity.yaw_rate_radps,
    )
