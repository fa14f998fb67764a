# SPDX-License-Identifier: MIT
"""An emulated I2C bus in real time, served on a Unix socket.

The far end is `sensing.drivers.i2c_bus.SocketBus`, or any program that speaks the frames of
docs/protocols.md, "Gyro and compass". Several clients may be connected, as on a real bus.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

from ins_robot.errors import DeviceError
from ins_robot.simulation.wire_device import RegisterDevice

READ, WRITE = 0x52, 0x57  # 'R', 'W'
LENGTH = struct.Struct("<H")
REQUEST = struct.Struct("<BBB")  # operation, device address, register
OK = b"\x00"
REQUEST_MAX = 512  # bytes; a longer one is not ours
READ_MAX = 255


class I2cSocketServer:
    """Serves register devices until closed."""

    def __init__(
        self, devices: Sequence[RegisterDevice], path: Path, clock: Callable[[], float]
    ) -> None:
        self._devices = {device.address: device for device in devices}
        self._path = path
        self._clock = clock
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()

    async def start(self) -> None:
        """Begin to listen; a socket left behind by a dead process is replaced.

        Raises
        ------
        DeviceError
            Another process serves this path, or it cannot be made.
        """
        if self._path.is_socket():
            if _is_served(self._path):
                raise DeviceError(f"{self._path}: another emulator already serves this bus")
            self._path.unlink()
        try:
            self._server = await asyncio.start_unix_server(self._serve, str(self._path))
        except OSError as error:
            raise DeviceError(
                f"{self._path}: cannot make this socket: {error.strerror or error}"
            ) from None

    async def close(self) -> None:
        """Hang up on all clients and remove the socket; may be called again."""
        server, self._server = self._server, None
        if server is None:
            return
        server.close()
        for writer in list(self._writers):
            writer.close()
        await server.wait_closed()
        self._path.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            while True:
                (length,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
                if not REQUEST.size <= length <= REQUEST_MAX:
                    break
                reply = self._answer(await reader.readexactly(length))
                writer.write(LENGTH.pack(len(reply)) + reply)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass  # the client has gone, or we are
        finally:
            self._writers.discard(writer)
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()

    def _answer(self, request: bytes) -> bytes:
        operation, address, register = REQUEST.unpack_from(request)
        rest = request[REQUEST.size :]
        device = self._devices.get(address)
        if device is None:
            return bytes([errno.EREMOTEIO])
        if operation == WRITE:
            device.write(register, rest, self._clock())
            return OK
        if operation == READ and len(rest) == LENGTH.size:
            (count,) = LENGTH.unpack(rest)
            if count <= READ_MAX:
                return OK + device.read(register, count, self._clock())
        return bytes([errno.EPROTO])


def _is_served(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        return probe.connect_ex(str(path)) == 0
