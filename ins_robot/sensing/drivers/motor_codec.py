# SPDX-License-Identifier: MIT
"""The host's side of the motor microcontroller's (MCU) wire: bytes to replies, orders to bytes.

Framing, CRC and layouts are those of `firmware.motor_mcu`, which the MCU itself runs; here they
get names, units and types. Noise costs counters, never the link.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from ins_robot.firmware import motor_mcu as mcu

FAULT_NAMES = {
    mcu.NO_FAULT: "",
    mcu.FAULT_NOT_CONFIGURED: "not_configured",
    mcu.FAULT_EMERGENCY_STOP: "emergency_stop",
    mcu.FAULT_CLIFF: "cliff",
    mcu.FAULT_BUMPER: "bumper",
    mcu.FAULT_DEAD_MAN: "dead_man",
    mcu.FAULT_WHEEL: "wheel",
}
_MAX_RADPS = 2e6  # what 32 bits of mrad/s hold


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """The MCU's answer to HELLO."""

    protocol: int
    firmware: str


@dataclass(frozen=True, slots=True, kw_only=True)
class McuConfig:
    """What the MCU must know of the base; it sends the same back once it is in force."""

    dead_man_ms: int
    counts_per_rev: int
    speed_max_mradps: int
    free_speed_mradps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Telemetry:
    """One telemetry frame; time and counts wrap at 32 bits, counts have the wiring's sign."""

    seq: int
    time_ms: int
    counts: tuple[int, int, int]
    bumper: bool
    cliff: bool
    emergency_stop: bool
    fault_code: int
    battery_v: float
    set_point_seq: int
    refused_frames: int
    dead_man_stops: int

    @property
    def fault(self) -> str:
        """Name of the latched fault, "" for none."""
        return FAULT_NAMES.get(self.fault_code, f"unknown fault {self.fault_code}")


Reply = Hello | McuConfig | Telemetry


class MotorCodec:
    """Decodes what the MCU sends, and encodes what it is told.

    Attributes
    ----------
    received_bytes : int
        All bytes fed.
    """

    def __init__(self) -> None:
        self.received_bytes = 0
        self._decoder = mcu.FrameDecoder()
        self._seq = 0

    @property
    def rejected(self) -> int:
        """How often bytes between two zero bytes were no frame."""
        return self._decoder.rejected

    def feed(self, data: bytes) -> list[Reply]:
        """The replies completed by `data`, which may be cut anywhere."""
        self.received_bytes += len(data)
        replies: list[Reply] = []
        for kind, seq, payload in self._decoder.feed(data):
            if kind == mcu.TELEMETRY:
                replies.append(_telemetry(seq, payload))
            elif kind == mcu.HELLO_REPLY:
                protocol, major, minor, patch = struct.unpack(mcu.HELLO_REPLY_FORMAT, payload)
                replies.append(Hello(protocol=protocol, firmware=f"{major}.{minor}.{patch}"))
            elif kind == mcu.CONFIG_REPLY:
                dead_man, counts, fastest, free = struct.unpack(mcu.CONFIG_FORMAT, payload)
                replies.append(
                    McuConfig(
                        dead_man_ms=dead_man,
                        counts_per_rev=counts,
                        speed_max_mradps=fastest,
                        free_speed_mradps=free,
                    )
                )
        return replies

    def hello(self) -> bytes:
        """Ask for the MCU's protocol and firmware."""
        return self._frame(mcu.HELLO, struct.pack(mcu.HELLO_FORMAT, mcu.PROTOCOL))

    def configure(self, config: McuConfig) -> bytes:
        """Tell the MCU its base; it stands until the next set point."""
        return self._frame(
            mcu.CONFIG,
            struct.pack(
                mcu.CONFIG_FORMAT,
                config.dead_man_ms,
                config.counts_per_rev,
                config.speed_max_mradps,
                config.free_speed_mradps,
            ),
        )

    def set_point(self, wheels_radps: tuple[float, float, float], validity_ms: int) -> bytes:
        """Wheel speeds, in the wiring's sign. Raises ValueError for one that is not finite."""
        if not all(map(math.isfinite, wheels_radps)):
            raise ValueError(f"wheel speeds {wheels_radps} rad/s: not finite")
        a, b, c = (round(max(-_MAX_RADPS, min(_MAX_RADPS, w)) * 1e3) for w in wheels_radps)
        return self._frame(
            mcu.SET_POINT, struct.pack(mcu.SET_POINT_FORMAT, a, b, c, validity_ms)
        )

    def rearm(self, fault_code: int) -> bytes:
        """Clear this latched fault, and no other."""
        return self._frame(mcu.REARM, struct.pack(mcu.REARM_FORMAT, fault_code))

    def _frame(self, kind: int, payload: bytes) -> bytes:
        self._seq = (self._seq + 1) & 0xFF
        return mcu.encode_frame(kind, self._seq, payload)


def _telemetry(seq: int, payload: bytes) -> Telemetry:
    time_ms, a, b, c, inputs, fault, battery_mv, set_point_seq, refused, stops = struct.unpack(
        mcu.TELEMETRY_FORMAT, payload
    )
    return Telemetry(
        seq=seq,
        time_ms=time_ms,
        counts=(a, b, c),
        bumper=bool(inputs & mcu.BUMPER),
        cliff=bool(inputs & mcu.CLIFF),
        emergency_stop=bool(inputs & mcu.EMERGENCY_STOP),
        fault_code=fault,
        battery_v=math.nan if battery_mv == mcu.BATTERY_NOT_MEASURED else battery_mv * 1e-3,
        set_point_seq=set_point_seq,
        refused_frames=refused,
        dead_man_stops=stops,
    )
