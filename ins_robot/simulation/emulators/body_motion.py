# SPDX-License-Identifier: MIT
"""What gyro and compass ask of the simulated body."""

from __future__ import annotations

from typing import Protocol


class BodyMotion(Protocol):
    """The body's motion and surroundings, in the base frame."""

    @property
    def temperature_c(self) -> float:
        """Temperature of the electronics."""
        ...

    def yaw_rate_radps(self, now_s: float) -> float:
        """True turn rate about +z, counter-clockwise."""
        ...

    def gyro_shift_dps(self, now_s: float) -> float:
        """What the gyro's z axis reads too much, beside its own bias."""
        ...

    def field_gauss(self, now_s: float) -> tuple[float, float, float]:
        """Magnetic field here, metal included, in the base frame's x, y and z."""
        ...
