# SPDX-License-Identifier: MIT
"""Three omni wheels: body velocity to wheel speeds and back.

A positive wheel speed drives the body counter-clockwise, for all three wheels. How a motor is
wired (`wheels.signs`) is the motor driver's business alone. The rim of the wheel at polar angle
a moves as its hub does along it: r w = -sin(a) vx + cos(a) vy + L omega.
"""

from __future__ import annotations

import math

from ins_robot.config import WheelsConfig
from ins_robot.errors import DegenerateGeometryError

Triple = tuple[float, float, float]
_DETERMINANT_MIN = 1e-3  # two wheels 0.03 degrees apart


class OmniKinematics:
    """Kinematics of a base with three omni wheels at any three different angles.

    Attributes
    ----------
    wheels_from_body, body_from_wheels : 3 rows of 3
        (vx_mps, vy_mps, yaw_rate_radps) to the wheels' radps, and its inverse.

    Raises
    ------
    DegenerateGeometryError
        If two wheels stand at the same angle: the wheels then cannot tell every motion.
    """

    def __init__(self, config: WheelsConfig) -> None:
        self._speed_max_radps = config.speed_max_radps
        self._rad_per_count = 2.0 * math.pi / (config.pulses_per_rev * config.quadrature)
        r, arm_m = config.radius_m, config.arm_m
        a, b, c = (math.radians(angle) for angle in config.angles_deg)
        self.wheels_from_body: tuple[Triple, Triple, Triple] = (
            (-math.sin(a) / r, math.cos(a) / r, arm_m / r),
            (-math.sin(b) / r, math.cos(b) / r, arm_m / r),
            (-math.sin(c) / r, math.cos(c) / r, arm_m / r),
        )
        # Determinant without r and L; the inverse is its adjugate over it.
        determinant = math.sin(b - a) + math.sin(c - b) + math.sin(a - c)
        if abs(determinant) < _DETERMINANT_MIN:
            raise DegenerateGeometryError(
                f"wheels.angles_deg = {list(config.angles_deg)}: two wheels stand at the same "
                "angle, so that some motion turns none of them"
            )
        d = determinant / r
        self.body_from_wheels: tuple[Triple, Triple, Triple] = (
            (
                (math.cos(b) - math.cos(c)) / d,
                (math.cos(c) - math.cos(a)) / d,
                (math.cos(a) - math.cos(b)) / d,
            ),
            (
                (math.sin(b) - math.sin(c)) / d,
                (math.sin(c) - math.sin(a)) / d,
                (math.sin(a) - math.sin(b)) / d,
            ),
            (
                math.sin(c - b) / (d * arm_m),
                math.sin(a - c) / (d * arm_m),
                math.sin(b - a) / (d * arm_m),
            ),
        )

    def wheel_speeds(self, vx_mps: float, vy_mps: float, yaw_rate_radps: float) -> Triple:
        """Wheel speeds in radps for a velocity of the base, in the base frame."""
        return _product(self.wheels_from_body, vx_mps, vy_mps, yaw_rate_radps)

    def twist(self, wheels_radps: Triple) -> Triple:
        """(vx_mps, vy_mps, yaw_rate_radps) of the base from wheel speeds."""
        return _product(self.body_from_wheels, *wheels_radps)

    def twist_from_counts(self, delta_counts: tuple[int, int, int], dt_s: float) -> Triple:
        """Mean (vx_mps, vy_mps, yaw_rate_radps) over `dt_s` > 0 from encoder differences.

        The counts are a `WheelSample`'s: the sign of the wiring is already applied.
        """
        scale = self._rad_per_count / dt_s
        a, b, c = delta_counts
        return _product(self.body_from_wheels, a * scale, b * scale, c * scale)

    def limited(self, wheels_radps: Triple) -> tuple[Triple, bool]:
        """Wheel speeds scaled together to `speed_max_radps`, so that the direction stays."""
        a, b, c = wheels_radps
        fastest = max(abs(a), abs(b), abs(c))
        if fastest <= self._speed_max_radps:
            return wheels_radps, False
        scale = self._speed_max_radps / fastest
        return (a * scale, b * scale, c * scale), True


def _product(rows: tuple[Triple, Triple, Triple], x: float, y: float, z: float) -> Triple:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z
