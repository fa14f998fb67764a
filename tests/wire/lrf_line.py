# SPDX-License-Identifier: MIT
"""An LRF driver joined to the emulated sensor in memory, by wires good and bad."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.messages import LaserScan
from ins_robot.sensing.drivers.lrf import LrfDriver
from ins_robot.sensing.ports import ByteStream
from ins_robot.sensing.scan_filter import is_at_speed
from ins_robot.simulation.emulators.lrf import LrfEmulator
from ins_robot.simulation.memory_wire import MemoryConnector
from ins_robot.simulation.wire_device import OpticsReading, WireDevice

TICK_S = 0.02
Mangle = Callable[[bytes], bytes]


def range_by_bearing_m(bearings_rad: np.ndarray) -> np.ndarray:
    """A room without symmetry: every bearing has its own range, 1.5 to 4.5 m."""
    return 3.0 + np.sin(bearings_rad) + 0.5 * np.cos(3.0 * bearings_rad)


class StandingOptics:
    """A room seen without noise; some beams get a code, some a warning."""

    def __init__(self) -> None:
        self.stamps_s: list[np.ndarray] = []

    def measure(self, stamps_s: np.ndarray, bearings_rad: np.ndarray) -> OpticsReading:
        assert (np.diff(stamps_s) > 0.0).all()
        self.stamps_s.append(stamps_s)
        degrees = np.rint(np.degrees(bearings_rad)).astype(int)
        is_lost = degrees % 10 == 0
        return OpticsReading(
            range_m=np.where(is_lost, np.nan, range_by_bearing_m(bearings_rad)),
            error_code=np.where(is_lost, 0x35, 0),
            strength=np.full(len(degrees), 400),
            is_weak=(degrees % 10 == 5) & ~is_lost,
        )


class ClockOptics:
    """Every beam measures the time: the range tells, in metres, the second of its stamp."""

    def measure(self, stamps_s: np.ndarray, bearings_rad: np.ndarray) -> OpticsReading:
        count = len(stamps_s)
        return OpticsReading(
            range_m=1.0 + stamps_s % 4.0,
            error_code=np.zeros(count, dtype=int),
            strength=np.full(count, 400),
            is_weak=np.zeros(count, dtype=bool),
        )


class BadWire:
    """Passes on what the device sends, mangled."""

    def __init__(self, device: WireDevice, mangle: Mangle) -> None:
        self._device = device
        self._mangle = mangle

    def receive(self, data: bytes, now_s: float) -> None:
        self._device.receive(data, now_s)

    def advance(self, now_s: float) -> bytes:
        return self._mangle(self._device.advance(now_s))


@dataclass
class Line:
    driver: LrfDriver
    emulator: LrfEmulator
    stream: ByteStream

    async def scan(self, revolutions: int = 5) -> list[LaserScan]:
        """Motor on, so many revolutions at the set speed, motor off."""
        await self.driver.motor_on()
        good: list[LaserScan] = []
        async for revolution in self.driver.revolutions():
            if is_at_speed(revolution, LrfConfig(), self.driver.set_rpm):
                good.append(revolution)
            if len(good) == revolutions:
                break
        await self.driver.motor_off()
        return good


@contextlib.asynccontextmanager
async def lrf_line(
    emulator: LrfEmulator,
    config: LrfConfig | None = None,
    *,
    mangle: Mangle | None = None,
    is_opened: bool = True,
) -> AsyncIterator[Line]:
    """A driver, opened, on a pumped line; call it on virtual time."""
    loop = asyncio.get_running_loop()
    device: WireDevice = BadWire(emulator, mangle) if mangle else emulator
    connector = MemoryConnector({"lrf": device}, [], loop.time)
    stream = await connector.open_stream("lrf", 115200)
    pump = asyncio.create_task(connector.pump("lrf", TICK_S))
    driver = LrfDriver(stream, config or LrfConfig(), loop.time)
    try:
        if is_opened:
            await driver.open()
        yield Line(driver, emulator, stream)
    finally:
        driver.close()
        pump.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await pump
