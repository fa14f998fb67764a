# SPDX-License-Identifier: MIT
"""The I2C bus: the kernel's, by smbus2, or an emulated one behind a Unix socket.

`open_i2c_bus` takes the address of a config and returns an `I2cBus`. Both kinds block, so one
thread owns them. The socket's frames are described in docs/protocols.md, "Gyro and compass".
"""

from __future__ import annotations

import errno
import os
import socket
import struct
from types import ModuleType
from typing import Any

from ins_robot.errors import DeviceError
from ins_robot.sensing.ports import I2cBus

SOCKET_PREFIX = "unix:"
SOCKET_TIMEOUT_S = 0.5

READ, WRITE = 0x52, 0x57  # 'R', 'W'
LENGTH = struct.Struct("<H")
REQUEST = struct.Struct("<BBB")  # operation, device address, register
OK = 0


def open_i2c_bus(address: str) -> I2cBus:
    """Open "/dev/i2c-1" or "unix:/path".

    Raises
    ------
    DeviceError
        The bus is not there or may not be used; the message says what to do.
    """
    if address.startswith(SOCKET_PREFIX):
        bus = SocketBus(address.removeprefix(SOCKET_PREFIX))
        bus.connect()
        return bus
    return KernelBus(address)


class KernelBus:
    """A bus of the Linux kernel, /dev/i2c-N."""

    def __init__(self, path: str) -> None:
        # Needs ioctl: only a machine that has such a bus gets here.
        smbus2: ModuleType
        import smbus2

        self._message: Any = smbus2.i2c_msg
        try:
            self._bus: Any = smbus2.SMBus(path)
        except OSError as error:
            raise DeviceError(f"{path}: cannot open this I2C bus: {_advice(error)}") from None

    def read(self, address: int, register: int, length: int) -> bytes:
        """Write the register number, then read with a repeated start: one transaction."""
        point = self._message.write(address, [register])
        data = self._message.read(address, length)
        self._bus.i2c_rdwr(point, data)
        return bytes(data)

    def write(self, address: int, register: int, data: bytes) -> None:
        """Write the register number and the data in one message."""
        self._bus.i2c_rdwr(self._message.write(address, [register, *data]))

    def close(self) -> None:
        """Close the file; may be called again."""
        self._bus.close()


def _advice(error: OSError) -> str:
    if error.errno == errno.ENOENT:
        return (
            "there is none; enable I2C (raspi-config, or dtparam=i2c_arm=on) and load i2c-dev"
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return "not allowed; add the user to the group i2c"
    return f"{error.strerror or error}"


class SocketBus:
    """A bus served by `simulation.i2c_socket`; reconnects by itself after a failure."""

    def __init__(self, path: str, timeout_s: float = SOCKET_TIMEOUT_S) -> None:
        self._path = path
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None

    def connect(self) -> None:
        """Connect now rather than at the first transfer, to fail where a config is read."""
        try:
            self._connected()
        except OSError as error:
            raise DeviceError(
                f"unix:{self._path}: no emulated I2C bus answers ({error.strerror or error}); "
                "is `ins-robot emulate` running?"
            ) from None

    def read(self, address: int, register: int, length: int) -> bytes:
        """Burst read over the socket."""
        data = self._exchange(REQUEST.pack(READ, address, register) + LENGTH.pack(length))
        if len(data) != length:
            self.close()
            raise OSError(errno.EPROTO, f"asked for {length} bytes, got {len(data)}")
        return data

    def write(self, address: int, register: int, data: bytes) -> None:
        """Burst write over the socket."""
        self._exchange(REQUEST.pack(WRITE, address, register) + data)

    def close(self) -> None:
        """Hang up; may be called again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _connected(self) -> socket.socket:
        if self._socket is None:
            line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            line.settimeout(self._timeout_s)
            try:
                line.connect(self._path)
            except OSError:
                line.close()
                raise
            self._socket = line
        return self._socket

    def _exchange(self, request: bytes) -> bytes:
        try:
            line = self._connected()
            line.sendall(LENGTH.pack(len(request)) + request)
            (length,) = LENGTH.unpack(_receive(line, LENGTH.size))
            reply = _receive(line, length)
        except OSError:
            self.close()  # half an exchange: the next one starts on a fresh line
            raise
        if not reply:
            self.close()
            raise OSError(errno.EPROTO, f"{self._path}: empty reply")
        if reply[0] != OK:
            raise OSError(reply[0], os.strerror(reply[0]))
        return reply[1:]


def _receive(line: socket.socket, length: int) -> bytes:
    received = bytearray()
    while len(received) < length:
        chunk = line.recv(length - len(received))
        if not chunk:
            raise ConnectionResetError(errno.ECONNRESET, "the emulated bus hung up")
        received += chunk
    return bytes(received)
