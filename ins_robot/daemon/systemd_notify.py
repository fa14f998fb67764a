# SPDX-License-Identifier: MIT
"""Tells systemd how the daemon is: ready, alive, stopping (sd_notify(3), Type=notify).

Without systemd ($NOTIFY_SOCKET unset) every method does nothing. The watchdog is fed by the
control task after a healthy tick, never by a timer of its own: a hung robot must be noticed.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping


class SystemdNotifier:
    """Datagrams to the socket that systemd names.

    `watchdog_period_s` is how often systemd wants to hear of us; None when it does not.
    """

    def __init__(self, address: str | None, watchdog_period_s: float | None = None) -> None:
        self.watchdog_period_s = watchdog_period_s
        self._socket: socket.socket | None = None
        self._address = ""
        self._fed_s: float | None = None
        if address:
            # A leading "@" stands for the NUL of Linux' abstract name space.
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC
            )
            self._socket.setblocking(False)

    @classmethod
    def from_environment(
        cls, environment: Mapping[str, str] = os.environ, pid: int | None = None
    ) -> SystemdNotifier:
        """As systemd set us up; its watchdog counts only when it is meant for this process."""
        wanted_pid = environment.get("WATCHDOG_PID")
        is_ours = wanted_pid is None or wanted_pid == str(os.getpid() if pid is None else pid)
        period_us = environment.get("WATCHDOG_USEC", "")
        is_watched = is_ours and period_us.isdigit() and int(period_us) > 0
        return cls(
            environment.get("NOTIFY_SOCKET"), int(period_us) * 1e-6 if is_watched else None
        )

    def ready(self, status: str) -> None:
        """The daemon serves; `systemctl start` returns."""
        self._send(f"READY=1\nSTATUS={_one_line(status)}")

    def status(self, text: str) -> None:
        """One line for `systemctl status`."""
        self._send(f"STATUS={_one_line(text)}")

    def stopping(self) -> None:
        """The daemon is on its way out."""
        self._send("STOPPING=1")

    def feed_watchdog(self, now_s: float) -> None:
        """Call after every healthy control tick; a datagram goes out every half period."""
        if self._socket is None or self.watchdog_period_s is None:
            return
        if self._fed_s is None or now_s - self._fed_s >= self.watchdog_period_s / 2:
            self._fed_s = now_s
            self._send("WATCHDOG=1")

    def close(self) -> None:
        """Close the socket; may be called again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            # systemd being away or behind is no reason for the robot to fail.
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)


def _one_line(text: str) -> str:
    return " ".join(text.split())
