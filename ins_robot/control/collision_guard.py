# SPDX-License-Identifier: MIT
"""The last word on every velocity: slower, or not at all, towards what is known to be there.

It knows the distance to the nearest obstacle of the map and, where the LRF runs while driving,
the points of the last revolution. It looks as far ahead as braking takes. Moving away from an
obstacle is always allowed, so a robot found too near a wall can leave it. Near obstacles it
slows the robot down, whichever way it goes: what is near is what is not fully known yet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ins_robot.config import ControlConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import VelocityCommand

REACTION_S = 0.15  # motor lag and one tick
CREEP_MPS = 0.06  # however near, this fast is safe
SQUEEZE_M = 0.02
SCALES = (1.0, 0.6, 0.3, 0.1)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What the guard knows of the obstacles, in the map frame.

    `distance_m` is (H, W), metres from a cell's centre to the nearest occupied cell's centre;
    `origin_m` the lower-left corner of cell (0, 0). `points_m` is (N, 2), seen while driving.
    """

    distance_m: np.ndarray
    origin_m: tuple[float, float]
    resolution_m: float
    points_m: FloatArray | None = None

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """From a place to the nearest known obstacle's surface; infinite off the map."""
        # Between cell centres, bilinear: half a cell matters in a doorway.
        row_at = (y_m - self.origin_m[1]) / self.resolution_m - 0.5
        col_at = (x_m - self.origin_m[0]) / self.resolution_m - 0.5
        row, col = math.floor(row_at), math.floor(col_at)
        height, width = self.distance_m.shape
        clearance = math.inf
        if 0 <= row < height - 1 and 0 <= col < width - 1:
            up, right, at = row_at - row, col_at - col, self.distance_m.item
            below = (1.0 - right) * at(row, col) + right * at(row, col + 1)
            above = (1.0 - right) * at(row + 1, col) + right * at(row + 1, col + 1)
            clearance = (1.0 - up) * below + up * above - 0.5 * self.resolution_m
            if math.isnan(clearance):  # no obstacle on the map at all: 0 * inf
                clearance = math.inf
        if self.points_m is not None and len(self.points_m):
            dx, dy = self.points_m[:, 0] - x_m, self.points_m[:, 1] - y_m
            clearance = min(clearance, math.sqrt(float((dx * dx + dy * dy).min())))
        return clearance


class CollisionGuard:
    """Slows or refuses a velocity that would end in a known obstacle."""

    def __init__(self, config: ControlConfig, robot_radius_m: float) -> None:
        self._radius_m = robot_radius_m
        self._keep_m = robot_radius_m + config.guard_margin_m
        self._brake_mps2 = config.accel_mps2
        self._time_s = config.guard_time_s
        self._surroundings: Surroundings | None = None
        self.is_squeezing = False  # after being stuck: trust the planner by half a cell more

    def observe(self, surroundings: Surroundings) -> None:
        """Replace what is known of the obstacles."""
        self._surroundings = surroundings

    def apply(self, pose: Pose2, wanted: VelocityCommand) -> tuple[VelocityCommand, bool]:
        """The velocity allowed at `pose` (map frame), and whether it differs."""
        speed = math.hypot(wanted.vx_mps, wanted.vy_mps)
        known = self._surroundings
        if known is None or speed < 1e-3:  # noqa: PLR2004 - standing
            return wanted, False
        c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
        ux = (c * wanted.vx_mps - s * wanted.vy_mps) / speed
        uy = (s * wanted.vx_mps + c * wanted.vy_mps) / speed
        here_m = known.clearance_m(pose.x_m, pose.y_m)
        pace = min(1.0, self._near_speed_mps(here_m) / speed)
        for scale in SCALES:
            ahead_m = self._stopping_m(scale * pace * speed)
            there_m = known.clearance_m(pose.x_m + ux * ahead_m, pose.y_m + uy * ahead_m)
            # At a crawl the margin may be used up: what the planner chose must let us through.
            is_crawl = scale * pace * speed <= CREEP_MPS
            if there_m >= min(self._least_m() if is_crawl else self._keep_m, here_m):
                return _scaled(wanted, scale * pace), scale < 1.0
        return VelocityCommand(yaw_rate_radps=wanted.yaw_rate_radps), True

    def clearance_m(self, pose: Pose2) -> float:
        """From the body at `pose` to the nearest known obstacle; infinite without one."""
        if self._surroundings is None:
            return math.inf
        return self._surroundings.clearance_m(pose.x_m, pose.y_m) - self._radius_m

    def _least_m(self) -> float:
        """What a crawl must keep: the body, less what the cells may have added to walls."""
        return self._radius_m - (SQUEEZE_M if self.is_squeezing else 0.0)

    def _near_speed_mps(self, here_m: float) -> float:
        """Fastest speed this near to an obstacle: distance over `control.guard_time_s`."""
        if self._time_s == 0.0:
            return math.inf
        return max(CREEP_MPS, (here_m - self._radius_m) / self._time_s)

    def blocks(self, here: tuple[float, float], points: Sequence[tuple[float, float]]) -> bool:
        """True when a body at one of `points` would touch what is known, and does not here."""
        known = self._surroundings
        if known is None:
            return False
        touching_m = min(self._radius_m, known.clearance_m(*here))
        return any(known.clearance_m(x_m, y_m) < touching_m for x_m, y_m in points)

    def _stopping_m(self, speed_mps: float) -> float:
        return speed_mps * REACTION_S + speed_mps**2 / (2.0 * self._brake_mps2)


class NoGuard:
    """For `control.guard = false`: lets everything pass."""

    is_squeezing = False

    def observe(self, surroundings: Surroundings) -> None:
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
