# SPDX-License-Identifier: MIT
"""The XV-11's rotor: its speed under the controller's regulator, and when each packet is full.

Moves in steps of 20 ms, the regulator's sample time, at constant speed within a step, on its
own time grid: the packets are the same however the emulator is polled. Figures: a real capture.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ins_robot.sensing.drivers.lrf_codec import (
    BEAMS_PER_PACKET,
    BEAMS_PER_TURN,
    PACKETS_PER_TURN,
)

_STEP_S = 0.02
_SPIN_UP_S = 0.3  # time constant: within 8 % of the set speed after 0.8 s
_COAST_RPMPS = 320.0  # loses speed evenly by friction
_BLOCKED_RPMPS = 4000.0
_RIPPLE_LAG_S = 0.15
_BOOT_RPM, _RESET_RPM = 60.0, 40.0  # the sensor wakes when turned, restarts when stopped
_FREE_PERIOD_S = 0.002  # much too slow, it sends as fast as its line goes, half a turn apart
_FREE_HOP = 45.5  # packets
_FULL_AT = (BEAMS_PER_PACKET - 1) / BEAMS_PER_PACKET  # a packet's share at its last beam


class DuePacket(NamedTuple):
    """One packet: `full_s` is the time of its last beam, `place` its index in the turn."""

    full_s: float
    place: int
    rpm: float
    beam_s: float


class Rotor:
    """Speed and angle over time.

    Attributes
    ----------
    set_rpm, is_driven, is_blocked
        What regulator and fingers ask for; they count from the next step on.
    restart_s : float or None
        When the sensor last restarted for want of rotation, until the owner clears it.
    """

    def __init__(self, rng: np.random.Generator, ripple: float, free_below_rpm: float) -> None:
        self._rng = rng
        self._ripple_std = ripple
        self._free_below_rpm = free_below_rpm
        self.set_rpm = 200.0
        self.is_driven = False
        self.is_blocked = False
        self.restart_s: float | None = None
        self._rpm = 0.0
        self._ripple = 0.0
        self._is_awake = False
        self._step_end_s = -math.inf
        self._packets = 0.0  # how far it has turned, in packets
        self._next = 0  # packet to come
        self._free_s = 0.0  # next free-running packet
        self._free_index = 0.0

    @property
    def is_at_rest(self) -> bool:
        """Nothing turns and nothing will."""
        return self._rpm == 0.0 and not self.is_driven

    def turn_to(self, now_s: float) -> list[DuePacket]:
        """Enter all steps that have begun by `now_s`; the packets that fill up in them.

        Some may be full after `now_s`, by up to one step.
        """
        due: list[DuePacket] = []
        if self._step_end_s == -math.inf:
            self._step_end_s = now_s
        while self._step_end_s <= now_s and not self.is_at_rest:
            self._step(due)
        if self.is_at_rest:
            self._step_end_s = -math.inf
        return due

    def _step(self, due: list[DuePacket]) -> None:
        start_s = self._step_end_s
        self._step_end_s = start_s + _STEP_S
        self._change_speed()
        rpm = self._rpm * (1.0 + self._ripple)
        if not self._is_awake:
            self._is_awake = self.is_driven and rpm > _BOOT_RPM
        elif rpm < _RESET_RPM:
            self._is_awake = False
            self.restart_s = start_s
        rate = rpm * PACKETS_PER_TURN / 60.0  # packets a second
        from_packets = self._packets
        self._packets += rate * _STEP_S
        if not self._is_awake or rpm < self._free_below_rpm:
            self._next = math.ceil(self._packets - _FULL_AT)
            if self._is_awake:
                self._run_free(start_s, rpm, due)
            return
        beam_s = 60.0 / (BEAMS_PER_TURN * rpm)
        while self._next + _FULL_AT < self._packets:
            full_s = start_s + (self._next + _FULL_AT - from_packets) / rate
            due.append(DuePacket(full_s, self._next % PACKETS_PER_TURN, rpm, beam_s))
            self._next += 1

    def _change_speed(self) -> None:
        if self.is_blocked:
            self._rpm = max(0.0, self._rpm - _BLOCKED_RPMPS * _STEP_S)
        elif self.is_driven:
            self._rpm += (self.set_rpm - self._rpm) * -math.expm1(-_STEP_S / _SPIN_UP_S)
        else:
            self._rpm = max(0.0, self._rpm - _COAST_RPMPS * _STEP_S)
        keep = math.exp(-_STEP_S / _RIPPLE_LAG_S)
        kick = math.sqrt(1.0 - keep * keep) * self._ripple_std
        self._ripple = keep * self._ripple + kick * self._rng.standard_normal()

    def _run_free(self, start_s: float, rpm: float, due: list[DuePacket]) -> None:
        self._free_s = max(self._free_s, start_s)
        while self._free_s < self._step_end_s:
            self._free_index = (self._free_index + _FREE_HOP) % PACKETS_PER_TURN
            due.append(DuePacket(self._free_s, int(self._free_index), rpm, 0.0))
            self._free_s += _FREE_PERIOD_S
