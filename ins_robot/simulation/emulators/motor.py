# SPDX-License-Identifier: MIT
"""The motor microcontroller (MCU) on a simulated base: its real firmware module, at 100 Hz.

A `WireDevice`: bytes of the host in, telemetry bytes out. The body it drives lives in the
kinematics' sign; the wiring (`wheels.signs`) is between the two, as on the robot.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from ins_robot.config import WheelsConfig
from ins_robot.firmware.motor_mcu import (
    BATTERY_NOT_MEASURED,
    BUMPER,
    CLIFF,
    EMERGENCY_STOP,
    STEP_MS,
    MotorMcu,
    wrap32,
)

_STEP_S = STEP_MS * 1e-3
_ROUNDING_S = 1e-9  # a call at the time of a step, computed otherwise, is that step


class BodyInputs(NamedTuple):
    """What the base's switches and its battery say."""

    bumper: bool = False
    cliff: bool = False
    emergency_stop: bool = False
    battery_v: float = math.nan


class Body(Protocol):
    """The simulated base, as its motors and encoders meet it."""

    def advance(self, to_s: float, duties: tuple[float, float, float]) -> None:
        """Live until `to_s` with these duties, in [-1, 1]; 1 drives the body ccw."""
        ...

    def counts(self) -> tuple[int, int, int]:
        """Encoder totals now; positive where the wheel drove the body ccw."""
        ...

    def inputs(self) -> BodyInputs:
        """Switches and battery now."""
        ...


class MotorEmulator:
    """Runs `MotorMcu` against a body; time starts with the first call.

    Parameters
    ----------
    body : Body
    config : WheelsConfig
        Only `signs`: the rest reaches the MCU over the wire, as on the robot.
    first_ms : int
        MCU time at the start; near 2**32 in tests of its wrap.
    """

    def __init__(self, body: Body, config: WheelsConfig, first_ms: int = 0) -> None:
        self._body = body
        a, b, c = (int(sign) for sign in config.signs)
        self._signs = (a, b, c)
        self._first_ms = first_ms
        self._mcu = MotorMcu()
        self._duties = (0.0, 0.0, 0.0)
        self._start_s = math.nan
        self._step_count = 0

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes from the host."""
        self._mcu.receive(data)

    def advance(self, now_s: float) -> bytes:
        """Live until `now_s`; what the MCU sent since the last call."""
        if math.isnan(self._start_s):
            self._start_s = now_s
        while True:
            due_s = self._start_s + self._step_count * _STEP_S
            if due_s > now_s + _ROUNDING_S:
                return self._mcu.transmit()
            self._step(due_s)

    def restart(self) -> None:
        """Break the MCU's supply for a moment: it starts anew and knows nothing."""
        self._mcu = MotorMcu()
        self._duties = (0.0, 0.0, 0.0)

    def _step(self, due_s: float) -> None:
        sign_a, sign_b, sign_c = self._signs
        body, (a, b, c) = self._body, self._duties
        body.advance(due_s, (a * sign_a, b * sign_b, c * sign_c))
        a_counts, b_counts, c_counts = body.counts()
        bumper, cliff, emergency_stop, battery_v = body.inputs()
        self._duties = self._mcu.step(
            self._first_ms + self._step_count * STEP_MS & 0xFFFFFFFF,
            (wrap32(a_counts * sign_a), wrap32(b_counts * sign_b), wrap32(c_counts * sign_c)),
            (BUMPER if bumper else 0)
            | (CLIFF if cliff else 0)
            | (EMERGENCY_STOP if emergency_stop else 0),
            BATTERY_NOT_MEASURED if math.isnan(battery_v) else round(battery_v * 1e3),
        )
        self._step_count += 1
