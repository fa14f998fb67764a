# SPDX-License-Identifier: MIT
"""Wires inside one process: the emulated devices at one end, the real drivers at the other.

`MemoryConnector` answers the addresses of a config with streams and a bus that carry the same
bytes and registers as the real ones. A pump advances the devices on the loop's clock.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence

from ins_robot.errors import DeviceError
from ins_robot.sensing.ports import ByteStream, I2cBus
from ins_robot.simulation.wire_device import RegisterDevice, WireDevice


class MemoryStream:
    """The host's end of a line to a `WireDevice`."""

    def __init__(self, device: WireDevice, clock: Callable[[], float]) -> None:
        self._device = device
        self._clock = clock
        self._arrived = bytearray()
        self._waiter: asyncio.Future[None] | None = None
        self._is_closed = False

    async def read(self) -> bytes:
        """Bytes that arrived; b"" once closed."""
        if not self._arrived and not self._is_closed:
            self._waiter = asyncio.get_running_loop().create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        chunk = bytes(self._arrived)
        self._arrived.clear()
        return chunk

    def write(self, data: bytes) -> None:
        """Hand bytes to the device at once."""
        if self._is_closed:
            raise DeviceError("simulated line: written to after it was closed")
        self._device.receive(data, self._clock())

    def close(self) -> None:
        """Close; wakes a waiting reader."""
        self._is_closed = True
        self._wake()

    def pump(self) -> None:
        """Let the device live until now, and take what it sent."""
        sent = self._device.advance(self._clock())
        if sent:
            self._arrived += sent
            self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class MemoryBus:
    """An I2C bus with emulated devices on it."""

    def __init__(self, devices: Sequence[RegisterDevice], clock: Callable[[], float]) -> None:
        self._devices = {device.address: device for device in devices}
        self._clock = clock

    def read(self, address: int, register: int, length: int) -> bytes:
        """Burst read; OSError (EREMOTEIO) where no device answers, as on Linux."""
        return self._device(address).read(register, length, self._clock())

    def write(self, address: int, register: int, data: bytes) -> None:
        """Burst write; OSError (EREMOTEIO) where no device answers."""
        self._device(address).write(register, data, self._clock())

    def close(self) -> None:
        """Nothing to release."""

    def _device(self, address: int) -> RegisterDevice:
        try:
            return self._devices[address]
        except KeyError:
            raise OSError(121, f"no device answers at 0x{address:02x}") from None


class MemoryConnector:
    """Opens the lines of a config onto emulated devices."""

    def __init__(
        self,
        devices: Mapping[str, WireDevice],
        registers: Sequence[RegisterDevice],
        clock: Callable[[], float],
    ) -> None:
        self._devices = devices
        self._registers = registers
        self._clock = clock
        self._streams: dict[str, MemoryStream] = {}

    async def open_stream(self, address: str, baud: int) -> ByteStream:
        """Open the line called `address`."""
        if address not in self._devices:
            known = ", ".join(sorted(self._devices))
            raise DeviceError(f"{address}: no such simulated line; there are: {known}")
        stream = MemoryStream(self._devices[address], self._clock)
        self._streams[address] = stream
        return stream

    def open_i2c(self, address: str) -> I2cBus:
        """Open the one simulated bus, whatever it is called."""
        return MemoryBus(self._registers, self._clock)

    async def pump(self, address: str, period_s: float) -> None:
        """Advance one device for ever, every `period_s`."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            stream = self._streams.get(address)
            if stream is not None:
                stream.pump()
            due_s += period_s
            await asyncio.sleep(due_s - loop.time())
