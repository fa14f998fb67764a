# SPDX-License-Identifier: MIT
"""Emulated devices on a pseudo-terminal: the wire itself, and the motors in real time."""

from __future__ import annotations

import asyncio
import os
from dataclasses import replace
from pathlib import Path

import pytest
from motor_line import COUNTS_PER_RAD, ScriptedBody

from ins_robot.config import WheelsConfig
from ins_robot.errors import DeviceError
from ins_robot.sensing.drivers.connector import SystemConnector
from ins_robot.sensing.drivers.motor import MotorDriver
from ins_robot.simulation.emulators.motor import MotorEmulator
from ins_robot.simulation.pty_wire import PtyWire


class Echo:
    """Sends back what it gets, and whatever `saying` holds at every call."""

    def __init__(self) -> None:
        self.received = b""
        self.saying = b""
        self._answer = b""

    def receive(self, data: bytes, now_s: float) -> None:
        self.received += data
        self._answer += data

    def advance(self, now_s: float) -> bytes:
        answer, self._answer = self._answer + self.saying, b""
        return answer


def open_terminal(link: Path) -> int:
    return os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def read_now(fd: int) -> bytes:
    data = b""
    try:
        while chunk := os.read(fd, 65536):
            data += chunk
    except BlockingIOError:
        pass
    return data


def test_every_byte_passes_unchanged(tmp_path: Path) -> None:
    async def main() -> None:
        device = Echo()
        wire = PtyWire(device, tmp_path / "line")
        await wire.open()
        fd = open_terminal(tmp_path / "line")
        wire.pump(0.0)
        os.write(fd, bytes(range(256)))
        wire.pump(0.0)
        assert device.received == bytes(range(256))
        assert read_now(fd) == bytes(range(256))
        os.close(fd)
        wire.close()

    asyncio.run(main())


def test_the_link_replaces_an_older_one_and_goes_with_the_wire(tmp_path: Path) -> None:
    async def main() -> None:
        link = tmp_path / "line"
        link.symlink_to("/dev/pts/of-a-run-that-crashed")
        wire = PtyWire(Echo(), link)
        await wire.open()
        os.close(open_terminal(link))
        wire.close()
        wire.close()

    asyncio.run(main())
    assert list(tmp_path.iterdir()) == []


def test_a_link_that_now_belongs_to_another_stays(tmp_path: Path) -> None:
    async def main() -> None:
        first, second = PtyWire(Echo(), tmp_path / "line"), PtyWire(Echo(), tmp_path / "line")
        await first.open()
        await second.open()
        first.close()
        os.close(open_terminal(tmp_path / "line"))
        second.close()

    asyncio.run(main())


@pytest.mark.parametrize("name", ["there is a file", "no/such/directory"])
def test_a_link_that_cannot_be_made_is_told(tmp_path: Path, name: str) -> None:
    async def main() -> None:
        (tmp_path / "there is a file").write_bytes(b"precious")
        with pytest.raises(DeviceError, match="cannot link the simulated terminal"):
            await PtyWire(Echo(), tmp_path / name).open()
        assert (tmp_path / "there is a file").read_bytes() == b"precious"

    asyncio.run(main())


def test_clients_come_and_go_and_read_nothing_old(tmp_path: Path) -> None:
    async def main() -> None:
        device = Echo()
        wire = PtyWire(device, tmp_path / "line")
        await wire.open()
        for client in range(3):
            device.saying = b"nobody hears this"
            wire.pump(0.0)
            device.saying = b""
            fd = open_terminal(tmp_path / "line")
            wire.pump(0.0)
            assert read_now(fd) == b""
            os.write(fd, b"client %d" % client)
            wire.pump(0.0)
            assert read_now(fd) == b"client %d" % client
            os.write(fd, b"left unread")
            wire.pump(0.0)
            os.close(fd)
            wire.pump(0.0)
        wire.close()

    asyncio.run(main())


def test_a_client_that_sleeps_loses_the_oldest(tmp_path: Path) -> None:
    async def main() -> None:
        device = Echo()
        wire = PtyWire(device, tmp_path / "line")
        await wire.open()
        fd = open_terminal(tmp_path / "line")
        for number in range(20_000):
            device.saying = b"%09d\n" % number
            wire.pump(0.0)
        device.saying = b""
        data = b""
        async with asyncio.timeout(2.0):
            while not data.endswith(b"19999\n"):  # the newest is there
                data += read_now(fd)
                await asyncio.sleep(0.001)
        assert len(data) < 70_000  # of 200 kB: no more than a terminal holds
        numbers = [int(line) for line in data.splitlines()[1:]]
        assert numbers == list(range(numbers[0], 20_000))
        os.close(fd)
        wire.close()

    asyncio.run(main())


def test_motors_over_a_terminal_in_real_time(tmp_path: Path) -> None:
    """Open, drive, leave, come back: the microcontroller outlives its clients."""

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        config = replace(WheelsConfig(), port=str(tmp_path / "motors"))
        body = ScriptedBody()
        wire = PtyWire(MotorEmulator(body, config), Path(config.port))
        await wire.open()
        for _ in range(2):
            stream = await SystemConnector().open_stream(config.port, config.baud)
            driver = MotorDriver(stream, config, clock)
            await driver.open()
            samples = []
            async for sample in driver.samples():
                samples.append(sample)
                driver.set_wheel_speeds((4.0, -4.0, 2.0))
                if len(samples) == 16:
                    break
            assert {sample.fault for sample in samples} == {""}
            assert driver.health.rejected_frames == driver.health.lost_frames == 0
            assert samples[-1].device_s == pytest.approx(0.3, abs=0.001)
            assert samples[-1].counts[0] > 0.1 * 4.0 * COUNTS_PER_RAD
            assert abs(clock() - samples[-1].stamp_s) < 0.1
            driver.close()
        again = await SystemConnector().open_stream(config.port, config.baud)
        wire.close()
        async with asyncio.timeout(1.0):
            assert await again.read() == b""
        again.close()

    asyncio.run(main())
