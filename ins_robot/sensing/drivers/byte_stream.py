# SPDX-License-Identifier: MIT
"""A serial port as a `ByteStream`: pyserial opens and sets it up, the event loop moves bytes.

No thread, no polling: the file descriptor is registered on the loop. Both directions have a
bound: unread bytes lose the oldest, as a UART would; unsent bytes mean that the line is stuck.
Works on a pseudo-terminal (pty) too, where baud is ignored and hang-up reads as the end.
"""

from __future__ import annotations

import asyncio
import errno
import os

import serial

from ins_robot.errors import DeviceError

READ_CHUNK = 4096
UNREAD_MAX = 32768  # 3 s of a full 115200 baud line
UNSENT_MAX = 4096

_CURES = {
    errno.ENOENT: "no such device; is it plugged in? `ls -l /dev/serial/by-id` shows what is",
    errno.ENXIO: "the device is gone; plug it in again",
    errno.ENODEV: "the device is gone; plug it in again",
    errno.EACCES: "not allowed for this user; add it to the group of the device, usually "
    "`sudo usermod -aG dialout $USER`, and log in again",
    errno.EBUSY: "in use by another program; `fuser -v` on it tells which",
    errno.EWOULDBLOCK: "in use by another program; `fuser -v` on it tells which",
    errno.EISDIR: "a directory, not a serial port",
    errno.ENOTTY: "not a serial port",
}


class SerialStream:
    """An open serial port, for one reader on the running loop.

    Parameters
    ----------
    port : str
        Device path.
    baud : int

    Attributes
    ----------
    overrun_bytes : int
        Bytes dropped because nobody read them in time.

    Raises
    ------
    DeviceError
        When the port cannot be opened; says why and what to do.
    """

    def __init__(self, port: str, baud: int) -> None:
        self.overrun_bytes = 0
        self._port = port
        self._serial = _open(port, baud)
        self._fd: int = self._serial.fileno()
        self._loop = asyncio.get_running_loop()
        self._unread = bytearray()
        self._unsent = bytearray()
        self._waiter: asyncio.Future[None] | None = None
        self._has_ended = False
        self._loop.add_reader(self._fd, self._receive)

    async def read(self) -> bytes:
        """Whatever has arrived, at least one byte; b"" when the far end has gone."""
        if not self._unread and not self._has_ended:
            self._waiter = self._loop.create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        data = bytes(self._unread)
        self._unread.clear()
        return data

    def write(self, data: bytes) -> None:
        """Send now as much as fits, queue the rest; never blocks.

        Raises
        ------
        DeviceError
            When the line is gone, or has taken nothing for UNSENT_MAX bytes.
        """
        if self._has_ended:
            raise DeviceError(f"{self._port}: the line is gone; unplugged, or closed")
        if len(self._unsent) + len(data) > UNSENT_MAX:
            raise DeviceError(
                f"{self._port}: takes no more bytes, {len(self._unsent)} are waiting (limit "
                f"{UNSENT_MAX}): the device hangs, or flow control is on"
            )
        was_idle = not self._unsent
        self._unsent += data
        if was_idle:
            self._send()
            if self._unsent and not self._has_ended:
                self._loop.add_writer(self._fd, self._send)

    def close(self) -> None:
        """Close; may be called again."""
        self._end()
        self._serial.close()

    def _receive(self) -> None:
        try:
            data = os.read(self._fd, READ_CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:  # EIO: the device is unplugged, or the pty's other end was closed
            data = b""
        if not data:
            self._end()
            return
        self._unread += data
        excess = len(self._unread) - UNREAD_MAX
        if excess > 0:
            del self._unread[:excess]
            self.overrun_bytes += excess
        self._wake()

    def _send(self) -> None:
        try:
            sent = os.write(self._fd, self._unsent)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._end()
            return
        del self._unsent[:sent]
        if not self._unsent:
            self._loop.remove_writer(self._fd)

    def _end(self) -> None:
        if not self._has_ended:
            self._has_ended = True
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            self._unsent.clear()
            self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


def _open(port: str, baud: int) -> serial.Serial:
    try:
        # timeout 0: non-blocking. pyserial sets raw mode, drops what came before, and forgives
        # a pty its missing DTR.
        return serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError) as error:  # SerialException is an OSError
        raise DeviceError(f"serial port {port}: {_reason(error, baud)}") from None


def _reason(error: Exception, baud: int) -> str:
    cause: BaseException | None = error
    while cause is not None:
        number = cause.args[0] if cause.args else None  # also of termios.error, no OSError
        if number in _CURES:
            return _CURES[number]
        cause = cause.__context__
    if isinstance(error, ValueError):
        return f"{baud} baud is not possible here ({error})"
    return f"cannot be opened ({error})"
