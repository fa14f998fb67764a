# SPDX-License-Identifier: MIT
"""An emulated device on a pseudo-terminal (pty), in real time, for any program to open.

The terminal is found by a stable symbolic link. As on a real line, clients may come and go, and
what nobody reads is lost, the oldest first.
"""

from __future__ import annotations

import asyncio
import os
import select
import termios
import tty
from pathlib import Path

from ins_robot.errors import DeviceError
from ins_robot.simulation.wire_device import WireDevice

PERIOD_S = 0.004
READ_CHUNK = 4096


class PtyWire:
    """Serves a `WireDevice` on a pty.

    Parameters
    ----------
    device : WireDevice
    link : Path
        Symbolic link to the terminal; an older link there is replaced, a file is not.
    """

    def __init__(self, device: WireDevice, link: Path) -> None:
        self._device = device
        self._link = link
        self._master = -1
        self._terminal = ""
        self._poll = select.poll()
        self._has_client = False
        self._timer: asyncio.TimerHandle | None = None

    async def open(self) -> None:
        """Make terminal and link, and serve them on the running loop until `close`.

        Raises
        ------
        DeviceError
            When the link cannot be made.
        """
        self._master, slave = os.openpty()
        self._terminal = os.ttyname(slave)
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        # Nobody at the terminal shows as POLLHUP; it lasts until a client opens it.
        os.close(slave)
        self._poll.register(self._master, select.POLLIN)
        try:
            self._publish()
        except OSError as error:
            self._hang_up()
            raise DeviceError(
                f"{self._link}: cannot link the simulated terminal there: {error.strerror}"
            ) from None
        self._tick()

    def pump(self, now_s: float) -> None:
        """Give the device what came, let it live until now, send what it said."""
        events = dict(self._poll.poll(0)).get(self._master, 0)
        had_client, self._has_client = self._has_client, not events & select.POLLHUP
        if events & select.POLLIN:
            received = self._receive()
            if received:
                self._device.receive(received, now_s)
        sent = self._device.advance(now_s)
        if self._has_client:
            if sent:
                self._send(sent)
        elif had_client:
            self._forget()  # what the client that left did not read is not for the next one

    def close(self) -> None:
        """Remove the link and hang up; may be called again."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            if self._link.is_symlink() and str(self._link.readlink()) == self._terminal:
                self._link.unlink()
            self._hang_up()

    def _hang_up(self) -> None:
        self._poll.unregister(self._master)
        os.close(self._master)

    def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(PERIOD_S, self._tick)
        self.pump(loop.time())

    def _publish(self) -> None:
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(None, "there is a file of that name")
        # Made beside it and moved over it: at no moment is there no link.
        fresh = self._link.with_name(f".{self._link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(self._terminal)
        fresh.replace(self._link)

    def _receive(self) -> bytes:
        try:
            return os.read(self._master, READ_CHUNK)
        except OSError:  # EIO: the client left in between
            return b""

    def _send(self, data: bytes) -> None:
        try:
            written = os.write(self._master, data)
        except BlockingIOError:
            written = 0
        except OSError:  # EIO: the client left in between
            return
        if written < len(data):
            self._forget()  # full: the client sleeps; the newest bytes are worth more
            try:
                os.write(self._master, data[written:])
            except OSError:
                return

    def _forget(self) -> None:
        """Drop what waits to be read at the terminal."""
        slave = os.open(self._terminal, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            termios.tcflush(self._master, termios.TCOFLUSH)
            termios.tcflush(slave, termios.TCIFLUSH)
        finally:
            os.close(slave)
