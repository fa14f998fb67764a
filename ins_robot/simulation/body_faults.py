# SPDX-License-Identifier: MIT
"""What can go wrong with the simulated body on purpose, and when (`simulate --fault`)."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class BodyFault(StrEnum):
    """A fault by name."""

    SLIP_BURST = "slip_burst"
    """Two wheels lose most of their grip: the body turns and falls behind its encoders."""
    STUCK = "stuck"
    """Wheels turn, the body stays: a carpet's edge."""
    CLIFF = "cliff"
    """The cliff input is on."""
    EMERGENCY_STOP = "emergency_stop"
    """The emergency-stop input is on."""
    BATTERY_LOW = "battery_low"
    """The battery reads 9 V."""
    GYRO_BIAS_STEP = "gyro_bias_step"
    """The gyro's bias is off by 2 deg/s more. An MPU-6050 may err by 20 deg/s between 25 and
    85 C, so 2 deg/s is a board that warms by 6 C, coming all at once as after a knock."""
    COMPASS_DISTURBED = "compass_disturbed"
    """The compass heading is turned by 30 degrees, the field as strong as ever: metal on the
    body that the compass gate cannot tell by the norm."""


class _Episode(NamedTuple):
    fault: BodyFault
    from_s: float
    duration_s: float


class FaultSchedule:
    """Which faults happen when, in robot time."""

    def __init__(self) -> None:
        self._episodes: list[_Episode] = []

    def add(self, fault: BodyFault, from_s: float, duration_s: float) -> None:
        """Let a fault happen for a while."""
        self._episodes.append(_Episode(fault, from_s, duration_s))

    def as_json(self) -> list[dict[str, str | float]]:
        """All of them, in the order they were added."""
        return [{**e._asdict(), "fault": str(e.fault)} for e in self._episodes]

    def active(self, now_s: float) -> frozenset[BodyFault]:
        """The faults that are happening."""
        if not self._episodes:
            return frozenset()
        return frozenset(
            e.fault for e in self._episodes if e.from_s <= now_s < e.from_s + e.duration_s
        )
