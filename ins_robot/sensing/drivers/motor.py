# SPDX-License-Identifier: MIT
"""The motor microcontroller (MCU): wheel speeds out, encoder counts and inputs in at 50 Hz.

This is the one place that knows how the motors are wired: `wheels.signs` is applied here, to
set points and to counts. Counts and MCU time start at 0 with the first sample after `open`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import TypeVar

from ins_robot.config import WheelsConfig
from ins_robot.errors import DeviceError, StateError
from ins_robot.firmware.motor_mcu import FAULT_NOT_CONFIGURED, NO_FAULT, PROTOCOL, wrap32
from ins_robot.messages import WheelSample
from ins_robot.sensing.drivers.device_clock import DeviceClock
from ins_robot.sensing.drivers.motor_codec import Hello, McuConfig, MotorCodec, Reply, Telemetry
from ins_robot.sensing.ports import ByteStream

R = TypeVar("R", bound=Reply)
log = logging.getLogger(__name__)

OPEN_TIMEOUT_S = 4.0  # boards that reset when the port opens need 2 s to start
ASK_AGAIN_S = 0.2
REARM_TIMEOUT_S = 1.0
REARM_AGAIN_S = 0.06  # three telemetry periods

_CURES = {
    "emergency_stop": "release the emergency stop button",
    "cliff": "move the robot away from the edge",
    "bumper": "free the bumper",
    "dead_man": "the host was too slow or the line lost bytes",
    "wheel": "a wheel is blocked, its encoder unplugged or wired backwards",
}


@dataclass(slots=True, kw_only=True)
class MotorHealth:
    """Counters since `open`; `mcu_` ones are the MCU's own, wrapping at 16 bits."""

    samples: int = 0
    lost_frames: int = 0
    rejected_frames: int = 0
    implausible_frames: int = 0
    set_points: int = 0
    mcu_refused_frames: int = 0
    mcu_dead_man_stops: int = 0
    firmware: str = ""


class MotorDriver:
    """Speaks to the MCU over a byte stream; made anew for every connection.

    Parameters
    ----------
    stream : ByteStream
        The open line; `close` closes it.
    config : WheelsConfig
    clock : callable
        Host time in s, monotonic: the event loop's.
    """

    def __init__(
        self, stream: ByteStream, config: WheelsConfig, clock: Callable[[], float]
    ) -> None:
        self.health = MotorHealth()
        self._stream = stream
        self._config = config
        self._clock = clock
        self._codec = MotorCodec()
        self._device_clock = DeviceClock()
        self._validity_ms = round(config.dead_man_s * 1e3)
        self._signs = tuple(int(sign) for sign in config.signs)
        self._fault_code = NO_FAULT
        self._fault = ""
        self._seq: int | None = None
        self._raw_counts = (0, 0, 0)
        self._counts = (0, 0, 0)

    async def open(self) -> None:
        """Identify and configure the MCU. A fault latched before stays latched.

        Raises
        ------
        DeviceError
            When it does not answer, speaks another protocol, or refuses the configuration.
        """
        hello = await self._ask(self._codec.hello, Hello)
        if hello is None:
            raise DeviceError(
                f"motors: {self._what_came()} on {self._config.port} within "
                f"{OPEN_TIMEOUT_S:g} s: wrong port, no power, or another speed than "
                f"{self._config.baud} baud"
            )
        if hello.protocol != PROTOCOL:
            raise DeviceError(
                f"motors: the microcontroller on {self._config.port} (firmware "
                f"{hello.firmware}) speaks protocol {hello.protocol}, this host protocol "
                f"{PROTOCOL}: bring the older of the two up to date"
            )
        self.health.firmware = hello.firmware
        wanted = self._mcu_config()
        got = await self._ask(lambda: self._codec.configure(wanted), McuConfig)
        if got != wanted:
            raise DeviceError(
                f"motors: the microcontroller on {self._config.port} did not take its "
                f"configuration: sent {wanted}, got back {got or 'nothing'}; the line loses "
                "bytes, or a value is beyond what the firmware allows"
            )
        log.info("motors: firmware %s on %s", hello.firmware, self._config.port)

    async def samples(self) -> AsyncIterator[WheelSample]:
        """Telemetry as it arrives, 50 Hz.

        Raises
        ------
        DeviceError
            When the line closes, falls silent for `silence_timeout_s`, or the MCU restarts.
        """
        silence_s = self._config.silence_timeout_s
        heard_s = self._clock()
        timeouts = 0
        while True:
            try:
                async with asyncio.timeout(silence_s / 2.0):
                    data = await self._read()
            except TimeoutError:
                timeouts += 1
                # A loop that was held up finds its timer and the bytes due at once, and the
                # timer wins: only a second timeout in a row means that nothing came.
                if timeouts > 1:
                    raise self._silence() from None
                continue
            timeouts = 0
            arrival_s = self._clock()
            for reply in self._replies(data):
                if isinstance(reply, Telemetry):
                    sample = self._sample(reply, arrival_s)
                    if sample is not None:
                        heard_s = arrival_s
                        yield sample
            if arrival_s - heard_s > silence_s:
                raise self._silence()

    def set_wheel_speeds(self, wheels_radps: tuple[float, float, float]) -> None:
        """Send one set point; good for `dead_man_s`, then the MCU stops the wheels.

        Raises
        ------
        DeviceError
            When the line is gone.
        ValueError
            For a speed that is not finite: nothing is sent.
        """
        a, b, c = wheels_radps
        sign_a, sign_b, sign_c = self._signs
        self._stream.write(
            self._codec.set_point((a * sign_a, b * sign_b, c * sign_c), self._validity_ms)
        )
        self.health.set_points += 1

    def stop(self) -> None:
        """Bring the wheels to rest, without a fault."""
        self.set_wheel_speeds((0.0, 0.0, 0.0))

    async def rearm(self) -> None:
        """Clear the latched fault; while another task reads `samples`.

        Raises
        ------
        StateError
            When the MCU keeps it, usually because its input is still on.
        """
        fault_code, fault = self._fault_code, self._fault
        if fault_code == NO_FAULT:
            return
        end_s = self._clock() + REARM_TIMEOUT_S
        while self._clock() < end_s:
            # Names the fault meant: a repetition cannot clear one that came in between.
            self._stream.write(self._codec.rearm(fault_code))
            await asyncio.sleep(REARM_AGAIN_S)
            if self._fault_code == NO_FAULT:
                log.info("motors: re-armed after %s", fault)
                return
        cure = _CURES.get(self._fault, "see the fault table")
        raise StateError(f"motors: fault '{self._fault}' cannot be cleared: {cure}, then again")

    def close(self) -> None:
        """Stop the wheels if the line still works, and close it; may be called again."""
        try:
            self.stop()
        except DeviceError:
            log.debug("motors: the line was gone before the wheels were told to stop")
        self._stream.close()

    async def _ask(self, question: Callable[[], bytes], kind: type[R]) -> R | None:
        """Repeat a question until a reply of that kind comes; None after OPEN_TIMEOUT_S."""
        end_s = self._clock() + OPEN_TIMEOUT_S
        while self._clock() < end_s:
            self._stream.write(question())
            try:
                async with asyncio.timeout(ASK_AGAIN_S):
                    while True:
                        for reply in self._replies(await self._read()):
                            if isinstance(reply, kind):
                                return reply
            except TimeoutError:
                continue
        return None

    async def _read(self) -> bytes:
        data = await self._stream.read()
        if not data:
            raise DeviceError(f"motors: {self._config.port} has gone: unplugged or reset")
        return data

    def _replies(self, data: bytes) -> list[Reply]:
        replies = self._codec.feed(data)
        self.health.rejected_frames = self._codec.rejected
        return replies

    def _silence(self) -> DeviceError:
        return DeviceError(
            f"motors: no telemetry on {self._config.port} for "
            f"{self._config.silence_timeout_s:g} s: cable, power, or a firmware that hangs; "
            "the wheels stop by the dead-man"
        )

    def _what_came(self) -> str:
        if self._codec.received_bytes == 0:
            return "no answer"
        return f"{self._codec.received_bytes} bytes came, but no answer to HELLO,"

    def _sample(self, frame: Telemetry, arrival_s: float) -> WheelSample | None:
        """The message of one frame; None for one whose time is not believed."""
        if frame.fault_code == FAULT_NOT_CONFIGURED:
            raise DeviceError(
                f"motors: the microcontroller on {self._config.port} restarted by itself: its "
                "supply broke down, or its watchdog bit; it is set up anew"
            )
        stamp_s = self._device_clock.stamp(frame.time_ms, arrival_s)
        health = self.health
        if stamp_s is None:
            health.implausible_frames += 1
            return None
        if self._seq is None:
            self._raw_counts = frame.counts
        else:
            health.lost_frames += (frame.seq - self._seq - 1) & 0xFF
        self._seq = frame.seq
        a, b, c = self._counts
        raw, last, signs = frame.counts, self._raw_counts, self._signs
        self._raw_counts = raw
        self._counts = (
            a + signs[0] * wrap32(raw[0] - last[0]),
            b + signs[1] * wrap32(raw[1] - last[1]),
            c + signs[2] * wrap32(raw[2] - last[2]),
        )
        if frame.fault_code != self._fault_code:
            self._fault_code, self._fault = frame.fault_code, frame.fault
            log.warning("motors: fault %s", self._fault or "cleared")
        health.samples += 1
        health.mcu_refused_frames = frame.refused_frames
        health.mcu_dead_man_stops = frame.dead_man_stops
        return WheelSample(
            stamp_s=stamp_s,
            device_s=self._device_clock.device_s,
            counts=self._counts,
            bumper=frame.bumper,
            cliff=frame.cliff,
            emergency_stop=frame.emergency_stop,
            fault=self._fault,
            battery_v=frame.battery_v,
        )

    def _mcu_config(self) -> McuConfig:
        config = self._config
        return McuConfig(
            dead_man_ms=round(config.dead_man_s * 1e3),
            counts_per_rev=config.pulses_per_rev * config.quadrature,
            speed_max_mradps=round(config.speed_max_radps * 1e3),
            free_speed_mradps=round(config.free_speed_radps * 1e3),
        )
