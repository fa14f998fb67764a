# SPDX-License-Identifier: MIT
"""The serial stream on a pseudo-terminal: bytes, bounds, hang-up, and errors that help."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ins_robot.errors import DeviceError
from ins_robot.sensing.drivers import byte_stream
from ins_robot.sensing.drivers.byte_stream import SerialStream
from ins_robot.sensing.drivers.connector import SystemConnector


class Terminal:
    """Both ends of a pty: `far` is the device's, `port` is what a host opens."""

    def __init__(self) -> None:
        self.far, near = os.openpty()
        tty.setraw(near)
        os.set_blocking(self.far, False)
        self.port = os.ttyname(near)
        self._near = near

    def hang_up(self) -> None:
        for fd in (self.far, self._near):
            if fd >= 0:
                os.close(fd)
        self.far = self._near = -1


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.hang_up()


async def read_all(stream: SerialStream, count: int) -> bytes:
    data = b""
    async with asyncio.timeout(2.0):
        while len(data) < count:
            data += await stream.read()
    return data


async def until(is_true: Callable[[], bool]) -> None:
    async with asyncio.timeout(2.0):
        while not is_true():  # noqa: ASYNC110 - the kernel tells no event
            await asyncio.sleep(0.001)


def write_until_refused(stream: SerialStream) -> int:
    written = 0
    try:
        for _ in range(10_000):
            stream.write(b"x" * 100)
            written += 100
    except DeviceError:
        return written
    raise AssertionError("a megabyte went into a line that nobody reads")


def test_bytes_pass_unchanged_both_ways(terminal: Terminal) -> None:
    every_byte = bytes(range(256))

    async def main() -> None:
        stream = await SystemConnector().open_stream(terminal.port, 115200)
        assert isinstance(stream, SerialStream)
        os.write(terminal.far, every_byte)
        assert await read_all(stream, 256) == every_byte
        stream.write(every_byte)
        assert os.read(terminal.far, 1000) == every_byte
        stream.close()
        stream.close()

    asyncio.run(main())


def test_a_read_waits_for_bytes_and_survives_being_cancelled(terminal: Terminal) -> None:
    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await stream.read()
        os.write(terminal.far, b"later")
        assert await read_all(stream, 5) == b"later"
        stream.close()

    asyncio.run(main())


def test_hang_up_reads_as_the_end_after_what_had_come(terminal: Terminal) -> None:
    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        os.write(terminal.far, b"last words")
        assert await read_all(stream, 10) == b"last words"
        terminal.hang_up()
        async with asyncio.timeout(1.0):
            assert await stream.read() == b""
            assert await stream.read() == b""
        with pytest.raises(DeviceError, match="the line is gone"):
            stream.write(b"anyone?")
        stream.close()

    asyncio.run(main())


def test_closing_wakes_a_waiting_reader(terminal: Terminal) -> None:
    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        asyncio.get_running_loop().call_later(0.01, stream.close)
        async with asyncio.timeout(1.0):
            assert await stream.read() == b""

    asyncio.run(main())


def test_what_came_before_opening_is_not_read(terminal: Terminal) -> None:
    async def main() -> None:
        os.write(terminal.far, b"old")
        stream = SerialStream(terminal.port, 115200)
        os.write(terminal.far, b"new")
        assert await read_all(stream, 3) == b"new"
        stream.close()

    asyncio.run(main())


def test_unread_bytes_lose_the_oldest(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(byte_stream, "UNREAD_MAX", 100)

    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        for number in range(50):
            os.write(terminal.far, b"%09d," % number)
            await asyncio.sleep(0)
        await until(lambda: stream.overrun_bytes >= 400)
        assert await stream.read() == b"".join(b"%09d," % number for number in range(40, 50))
        assert stream.overrun_bytes == 400
        stream.close()

    asyncio.run(main())


def test_a_device_that_takes_nothing_is_told_of(terminal: Terminal) -> None:
    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        written = write_until_refused(stream)
        with pytest.raises(DeviceError, match="takes no more bytes"):
            stream.write(b"x" * 100)
        # It recovers: what was accepted arrives once the device reads again.
        received = 0
        while received < written:
            try:
                received += len(os.read(terminal.far, 65536))
            except BlockingIOError:
                await asyncio.sleep(0.001)
        assert received == written
        stream.write(b"again")
        assert os.read(terminal.far, 100) == b"again"
        stream.close()

    asyncio.run(main())


def test_a_port_in_use_is_told(terminal: Terminal) -> None:
    async def main() -> None:
        stream = SerialStream(terminal.port, 115200)
        with pytest.raises(DeviceError, match="in use by another program"):
            SerialStream(terminal.port, 115200)
        stream.close()
        SerialStream(terminal.port, 115200).close()

    asyncio.run(main())


def test_a_port_that_cannot_be_opened_says_why(tmp_path: Path) -> None:
    plain_file = tmp_path / "file"
    plain_file.write_bytes(b"")
    forbidden = OSError(13, "Permission denied")

    async def main() -> None:
        for port, words in (
            (tmp_path / "ttyACM9", "no such device; is it plugged in"),
            (tmp_path, "a directory, not a serial port"),
            (plain_file, "not a serial port"),
        ):
            with pytest.raises(DeviceError, match=words) as caught:
                await SystemConnector().open_stream(str(port), 115200)
            assert str(port) in str(caught.value)
            assert "\n" not in str(caught.value)

    asyncio.run(main())
    assert "dialout" in byte_stream._reason(forbidden, 115200)
