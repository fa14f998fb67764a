# SPDX-License-Identifier: MIT
"""A motor driver joined to the emulated microcontroller in memory, by wires good and bad."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, replace

import numpy as np

from ins_robot.config import WheelsConfig
from ins_robot.messages import WheelSample
from ins_robot.sensing.drivers.motor import MotorDriver
from ins_robot.sensing.ports import ByteStream
from ins_robot.simulation.emulators.motor import BodyInputs, MotorEmulator
from ins_robot.simulation.memory_wire import MemoryConnector
from ins_robot.simulation.wire_device import WireDevice

COUNTS_PER_RAD = 4096 / (2.0 * np.pi)
FREE_SPEED_RADPS = 12.0
Mangle = Callable[[bytes], bytes]


class ScriptedBody:
    """Three free wheels with a motor lag; switches and battery as the test sets them."""

    def __init__(self, lag_s: float = 0.08, first_counts: int = 0) -> None:
        self.inputs_now = BodyInputs(battery_v=12.0)
        self.speeds_radps = [0.0, 0.0, 0.0]
        self.duties = (0.0, 0.0, 0.0)
        self.is_blocked = False
        self._lag_s = lag_s
        self._first_counts = first_counts
        self._turned_rad = [0.0, 0.0, 0.0]
        self._now_s: float | None = None

    def advance(self, to_s: float, duties: tuple[float, float, float]) -> None:
        dt_s = 0.0 if self._now_s is None else to_s - self._now_s
        self._now_s = to_s
        self.duties = duties
        share = 1.0 - np.exp(-dt_s / self._lag_s)
        for i, duty in enumerate(duties):
            before = self.speeds_radps[i]
            goal = 0.0 if self.is_blocked else duty * FREE_SPEED_RADPS
            self.speeds_radps[i] += share * (goal - before)
            self._turned_rad[i] += 0.5 * dt_s * (before + self.speeds_radps[i])

    def counts(self) -> tuple[int, int, int]:
        a, b, c = (self._first_counts + round(t * COUNTS_PER_RAD) for t in self._turned_rad)
        return a, b, c

    def inputs(self) -> BodyInputs:
        return self.inputs_now

    def set_inputs(self, **inputs: bool) -> None:
        self.inputs_now = BodyInputs(battery_v=12.0, **inputs)


class BadWire:
    """A device behind wires that mangle what passes."""

    def __init__(self, device: WireDevice, to_device: Mangle, to_host: Mangle) -> None:
        self.device, self.to_device, self.to_host = device, to_device, to_host

    def receive(self, data: bytes, now_s: float) -> None:
        self.device.receive(self.to_device(data), now_s)

    def advance(self, now_s: float) -> bytes:
        return self.to_host(self.device.advance(now_s))


class OneByteStream:
    """Hands bytes over one at a time, in both directions."""

    def __init__(self, stream: ByteStream) -> None:
        self._stream = stream
        self._waiting = b""

    async def read(self) -> bytes:
        if not self._waiting:
            self._waiting = await self._stream.read()
        byte, self._waiting = self._waiting[:1], self._waiting[1:]
        return byte

    def write(self, data: bytes) -> None:
        for byte in data:
            self._stream.write(bytes([byte]))

    def close(self) -> None:
        self._stream.close()


def perfect(data: bytes) -> bytes:
    return data


def dropping(one_in: float, seed: int) -> Mangle:
    """Loses each byte with a chance of 1 in `one_in`."""
    rng = np.random.default_rng(seed)

    def mangle(data: bytes) -> bytes:
        kept = rng.random(len(data)) >= 1.0 / one_in
        return bytes(np.frombuffer(data, dtype=np.uint8)[kept])

    return mangle


def noisy(seed: int) -> Mangle:
    """Puts bursts of random bytes before half of the chunks, and flips a bit in some others."""
    rng = np.random.default_rng(seed)

    def mangle(data: bytes) -> bytes:
        if not data:
            return data
        chance = rng.random()
        if chance < 0.5:
            return rng.bytes(int(rng.integers(1, 60))) + data
        if chance < 0.7:
            wrong = bytearray(data)
            wrong[rng.integers(len(data))] ^= 1 << rng.integers(8)
            return bytes(wrong)
        return data

    return mangle


@dataclass
class Line:
    """A driver, the emulator behind it, and the body it drives."""

    driver: MotorDriver
    emulator: MotorEmulator
    body: ScriptedBody
    wire: BadWire
    stream: ByteStream
    config: WheelsConfig

    async def drive(
        self, seconds: float, wheels_radps: tuple[float, float, float] | None = None
    ) -> list[WheelSample]:
        """Answer every sample with this set point (None: with silence), as the daemon does."""
        samples: list[WheelSample] = []
        clock = asyncio.get_running_loop().time
        end_s = clock() + seconds
        async with contextlib.aclosing(self.driver.samples()) as stream:  # type: ignore[type-var]
            async for sample in stream:
                samples.append(sample)
                if wheels_radps is not None:
                    self.driver.set_wheel_speeds(wheels_radps)
                if clock() >= end_s:
                    break
        return samples


@contextlib.asynccontextmanager
async def joined(
    *,
    to_device: Mangle = perfect,
    to_host: Mangle = perfect,
    is_bytewise: bool = False,
    first_ms: int = 0,
    first_counts: int = 0,
    lag_s: float = 0.08,
    is_open: bool = True,
    **options: object,
) -> AsyncIterator[Line]:
    """A line with its pump running; for `run_virtual`."""
    loop = asyncio.get_running_loop()
    config = replace(WheelsConfig(), **options)  # type: ignore[arg-type]
    body = ScriptedBody(lag_s, first_counts)
    emulator = MotorEmulator(body, config, first_ms)
    wire = BadWire(emulator, to_device, to_host)
    connector = MemoryConnector({config.port: wire}, [], loop.time)
    stream = await connector.open_stream(config.port, config.baud)
    if is_bytewise:
        stream = OneByteStream(stream)
    driver = MotorDriver(stream, config, loop.time)
    pump = loop.create_task(connector.pump(config.port, 0.005))
    try:
        if is_open:
            await driver.open()
        yield Line(driver, emulator, body, wire, stream, config)
    finally:
        pump.cancel()
        stream.close()
