# SPDX-License-Identifier: MIT
"""Opens the real lines: serial ports by pyserial, I2C buses by smbus2 or a Unix socket.

The simulated counterpart is `simulation.memory_wire.MemoryConnector`.
"""

from __future__ import annotations

from ins_robot.sensing.drivers.byte_stream import SerialStream
from ins_robot.sensing.drivers.i2c_bus import open_i2c_bus
from ins_robot.sensing.ports import ByteStream, I2cBus


class SystemConnector:
    """Turns the addresses of a config into open lines of this machine."""

    async def open_stream(self, address: str, baud: int) -> ByteStream:
        """Open a serial port on the running loop. Raises DeviceError that says why not."""
        return SerialStream(address, baud)

    def open_i2c(self, address: str) -> I2cBus:
        """Open "/dev/i2c-1" or "unix:/path". Raises DeviceError that says why not."""
        return open_i2c_bus(address)
