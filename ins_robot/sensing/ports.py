# SPDX-License-Identifier: MIT
"""The seams to the outside, each with its real and its simulated implementation.

ByteStream   `sensing.drivers.byte_stream` (pyserial)     | `simulation.memory_wire`
I2cBus       `sensing.drivers.i2c_bus` (smbus2, Unix socket) | `simulation.memory_wire`
Connector    `sensing.drivers.connector`                  | `simulation.memory_wire`
"""

from __future__ import annotations

from typing import Protocol


class ByteStream(Protocol):
    """A serial line: bytes in, bytes out, on the event loop."""

    async def read(self) -> bytes:
        """Whatever has arrived, at least one byte; b"" when the far end has gone."""
        ...

    def write(self, data: bytes) -> None:
        """Queue bytes for sending; never blocks. Raises DeviceError when the line is gone."""
        ...

    def close(self) -> None:
        """Close; may be called again."""
        ...


class I2cBus(Protocol):
    """Register access, blocking: Linux has no readiness event for I2C, so a thread owns it."""

    def read(self, address: int, register: int, length: int) -> bytes:
        """Burst read. Raises OSError when the device does not answer."""
        ...

    def write(self, address: int, register: int, data: bytes) -> None:
        """Burst write. Raises OSError when the device does not answer."""
        ...

    def close(self) -> None:
        """Close; may be called again."""
        ...


class Connector(Protocol):
    """Turns the addresses of a config into open lines."""

    async def open_stream(self, address: str, baud: int) -> ByteStream:
        """Open a serial line. Raises DeviceError that says what is wrong with `address`."""
        ...

    def open_i2c(self, address: str) -> I2cBus:
        """Open an I2C bus: "/dev/i2c-1" or "unix:/path". Raises DeviceError."""
        ...
