# SPDX-License-Identifier: MIT
"""From a planned path to a reference trajectory: where to be, how fast, facing what, and when.

Way points -> arc length -> fastest speed profile within cruise speed, acceleration, turn rate
and corner sharpness (forward and backward pass) -> time. x, y and heading have references of
their own, because an omni base tracks them independently.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from ins_robot.config import ControlConfig
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.messages import PlannedPath

STEP_M = 0.02  # spacing of the profile
CORNER_DEVIATION_M = 0.01  # how far a corner may be cut by the acceleration limit
TURN_SHARE = 0.8  # share of the turn limit the reference uses; the rest corrects errors


@dataclass(frozen=True, slots=True)
class Reference:
    """The wanted state at one time, in the path's frame."""

    x_m: float
    y_m: float
    heading_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


class ReferenceTrajectory:
    """A path with times.

    Parameters
    ----------
    path : PlannedPath
        At least one point. The first heading is the one the robot starts with.
    """

    def __init__(self, path: PlannedPath, config: ControlConfig) -> None:
        points, headings = _densify(path)
        turns_rad = np.abs(np.diff(headings))
        lengths_m = np.hypot(*np.diff(points, axis=0).T)
        speeds = _speed_profile(points, lengths_m, turns_rad, config)
        mean_speed = np.maximum(0.5 * (speeds[:-1] + speeds[1:]), 1e-3)
        durations = np.where(
            lengths_m > 0.0,
            lengths_m / mean_speed,
            turns_rad / (TURN_SHARE * config.turn_radps),
        )
        self._t: list[float] = np.concatenate([[0.0], np.cumsum(durations)]).tolist()
        self._x: list[float] = points[:, 0].tolist()
        self._y: list[float] = points[:, 1].tolist()
        self._heading: list[float] = headings.tolist()
        self.duration_s: float = self._t[-1]
        self.end = Reference(
            self._x[-1], self._y[-1], wrap_rad(self._heading[-1]), 0.0, 0.0, 0.0
        )

    def at(self, t_s: float) -> Reference:
        """The reference `t_s` after the start; stands at the end afterwards."""
        if t_s >= self.duration_s:
            return self.end
        i = max(0, bisect_right(self._t, t_s) - 1)
        span = self._t[i + 1] - self._t[i]
        u = (t_s - self._t[i]) / span if span > 0.0 else 1.0
        dx, dy = self._x[i + 1] - self._x[i], self._y[i + 1] - self._y[i]
        turn = self._heading[i + 1] - self._heading[i]
        rate = 1.0 / span if span > 0.0 else 0.0
        return Reference(
            self._x[i] + u * dx,
            self._y[i] + u * dy,
            wrap_rad(self._heading[i] + u * turn),
            dx * rate,
            dy * rate,
            turn * rate,
        )


def _densify(path: PlannedPath) -> tuple[FloatArray, FloatArray]:
    """Points every STEP_M with unwrapped headings; a turn on the spot gets steps of its own."""
    points: list[FloatArray] = [path.points_m[:1]]
    headings: list[FloatArray] = [path.headings_rad[:1]]
    for i in range(1, len(path.points_m)):
        a, b = path.points_m[i - 1], path.points_m[i]
        start = headings[-1][-1]
        turn = wrap_rad(float(path.headings_rad[i] - start))
        length = math.hypot(*(b - a))
        steps = max(1, math.ceil(length / STEP_M), math.ceil(abs(turn) / math.radians(5.0)))
        u = np.arange(1, steps + 1) / steps
        points.append(a + u[:, None] * (b - a))
        headings.append(start + u * turn)
    return np.concatenate(points), np.concatenate(headings)


def _speed_profile(
    points: FloatArray, lengths_m: FloatArray, turns_rad: FloatArray, config: ControlConfig
) -> FloatArray:
    """Fastest speed at each point: starts and ends at rest, respects every limit."""
    n = len(points)
    speeds = np.full(n, config.cruise_mps)
    speeds[0] = speeds[-1] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        by_turn = TURN_SHARE * config.turn_radps * lengths_m / turns_rad
    by_turn = np.where(turns_rad > 0.0, by_turn, np.inf)
    speeds[1:] = np.minimum(speeds[1:], by_turn)
    speeds[:-1] = np.minimum(speeds[:-1], by_turn)
    moves = np.diff(points, axis=0)
    bearings = np.arctan2(moves[:, 1], moves[:, 0])
    corner = np.zeros(n)
    corner[1:-1] = np.abs(wrap_rad(np.diff(bearings)))
    # Rounding a corner of angle c at acceleration a cuts it by about (v tan(c/2))^2 / (2 a).
    bend = np.tan(np.minimum(corner, math.pi - 0.1) / 2.0)
    sharp = corner > math.radians(5.0)
    limit = np.sqrt(2.0 * config.accel_mps2 * CORNER_DEVIATION_M) / np.maximum(bend, 1e-6)
    speeds[sharp] = np.minimum(speeds[sharp], limit[sharp])
    for order in (range(1, n), range(n - 2, -1, -1)):  # forward, then backward; once per path
        for i in order:
            j, k = (i - 1, i - 1) if order.step > 0 else (i + 1, i)
            reachable = math.sqrt(speeds[j] ** 2 + 2.0 * config.accel_mps2 * lengths_m[k])
            if lengths_m[k] > 0.0:
                speeds[i] = min(speeds[i], reachable)
            else:
                speeds[i] = 0.0
    return speeds
