# SPDX-License-Identifier: MIT
"""What systemd hears, by a socket in its place."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from ins_robot.daemon.systemd_notify import SystemdNotifier


class FakeSystemd:
    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.setblocking(False)

    def heard(self) -> list[str]:
        messages = []
        while True:
            try:
                messages.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return messages


@pytest.fixture
def address(tmp_path: Path) -> str:
    return str(tmp_path / "notify")


@pytest.fixture
def systemd(address: str) -> Iterator[FakeSystemd]:
    systemd = FakeSystemd(address)
    yield systemd
    systemd.socket.close()


def test_the_life_of_a_daemon(systemd: FakeSystemd, address: str) -> None:
    notifier = SystemdNotifier.from_environment({"NOTIFY_SOCKET": address})
    notifier.ready("waiting for\na start")
    notifier.status("exploring, 7 scans")
    notifier.stopping()
    notifier.close()
    notifier.close()
    assert systemd.heard() == [
        "READY=1\nSTATUS=waiting for a start",
        "STATUS=exploring, 7 scans",
        "STOPPING=1",
    ]


def test_the_watchdog_hears_every_half_period_while_fed(
    systemd: FakeSystemd, address: str
) -> None:
    environment = {
        "NOTIFY_SOCKET": address,
        "WATCHDOG_USEC": "10000000",
        "WATCHDOG_PID": str(os.getpid()),
    }
    notifier = SystemdNotifier.from_environment(environment)
    assert notifier.watchdog_period_s == pytest.approx(10.0)
    sent_s = []
    for tick in range(1000):  # 20 s at 50 Hz
        notifier.feed_watchdog(100.0 + tick * 0.02)
        sent_s += [tick * 0.02 for message in systemd.heard() if message == "WATCHDOG=1"]
    notifier.close()
    assert sent_s == pytest.approx([0.0, 5.0, 10.0, 15.0], abs=0.05)


@pytest.mark.parametrize(
    "watchdog",
    [
        {},
        {"WATCHDOG_USEC": "0"},
        {"WATCHDOG_USEC": "soon"},
        {"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "1"},  # meant for another process
    ],
)
def test_no_watchdog_of_ours_is_not_fed(
    systemd: FakeSystemd, address: str, watchdog: dict[str, str]
) -> None:
    notifier = SystemdNotifier.from_environment({"NOTIFY_SOCKET": address, **watchdog}, pid=77)
    notifier.feed_watchdog(0.0)
    notifier.close()
    assert systemd.heard() == []


def test_the_abstract_name_space() -> None:
    name = f"ins-robot-test-{os.getpid()}"
    systemd = FakeSystemd("\0" + name)
    notifier = SystemdNotifier("@" + name)
    notifier.ready("x")
    assert systemd.heard() == ["READY=1\nSTATUS=x"]
    notifier.close()
    systemd.socket.close()


def test_without_systemd_and_with_one_that_has_gone_nothing_happens(tmp_path: Path) -> None:
    for notifier in (
        SystemdNotifier.from_environment({}),
        SystemdNotifier(str(tmp_path / "gone"), 1.0),
    ):
        notifier.ready("x")
        notifier.feed_watchdog(0.0)
        notifier.stopping()
        notifier.close()
        notifier.status("after closing")


def test_a_systemd_that_does_not_read_does_not_block_the_robot(
    systemd: FakeSystemd, address: str
) -> None:
    notifier = SystemdNotifier(address)
    for _ in range(10_000):  # many more than its queue holds
        notifier.status("x" * 100)
    notifier.close()
