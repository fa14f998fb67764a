# SPDX-License-Identifier: MIT
"""Speed and acceleration limits of the base; saturation is told, not hidden."""

from __future__ import annotations

import math

from ins_robot.config import ControlConfig
from ins_robot.messages import VelocityCommand

SPEED_HEADROOM = 1.5  # corrections may exceed cruise speed by this factor
BRAKE_FACTOR = 2.5  # braking may be this much harder than speeding up


class VelocityLimits:
    """Limits a wanted velocity by speed, then by its change since the last command."""

    def __init__(self, config: ControlConfig) -> None:
        self._config = config
        self._last = VelocityCommand()

    def reset(self) -> None:
        """The wheels stand: the next command starts from rest."""
        self._last = VelocityCommand()

    def follow(self, actual: VelocityCommand) -> None:
        """The command that was really given, after whatever came behind these limits."""
        self._last = actual

    def apply(self, wanted: VelocityCommand, dt_s: float) -> tuple[VelocityCommand, bool]:
        """The nearest allowed velocity, and whether it differs from the wanted one."""
        config = self._config
        speed_max = SPEED_HEADROOM * config.cruise_mps
        speed = math.hypot(wanted.vx_mps, wanted.vy_mps)
        scale = min(1.0, speed_max / speed) if speed > 0.0 else 1.0
        vx, vy = wanted.vx_mps * scale, wanted.vy_mps * scale
        yaw = min(config.turn_radps, max(-config.turn_radps, wanted.yaw_rate_radps))
        dvx, dvy = vx - self._last.vx_mps, vy - self._last.vy_mps
        change = math.hypot(dvx, dvy)
        is_braking = math.hypot(vx, vy) < math.hypot(self._last.vx_mps, self._last.vy_mps)
        step = config.accel_mps2 * dt_s * (BRAKE_FACTOR if is_braking else 1.0)
        if change > step:
            vx = self._last.vx_mps + dvx * step / change
            vy = self._last.vy_mps + dvy * step / change
        yaw_step = config.yaw_accel_radps2 * dt_s
        yaw = self._last.yaw_rate_radps + min(
            yaw_step, max(-yaw_step, yaw - self._last.yaw_rate_radps)
        )
        self._last = VelocityCommand(vx_mps=vx, vy_mps=vy, yaw_rate_radps=yaw)
        was_limited = scale < 1.0 or change > step or yaw != wanted.yaw_rate_radps
        return self._last, was_limited
