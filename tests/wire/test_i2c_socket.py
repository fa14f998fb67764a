# SPDX-License-Identifier: MIT
"""The Unix-socket bus in real time: real driver, real thread, emulated chips, bad clients."""

from __future__ import annotations

import asyncio
import errno
import socket
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from imu_bench import Turntable, gyro, hmc

from ins_robot.config import ImuConfig
from ins_robot.errors import DeviceError
from ins_robot.sensing.drivers.i2c_bus import SocketBus, open_i2c_bus
from ins_robot.sensing.drivers.imu import ImuDriver
from ins_robot.simulation.i2c_socket import I2cSocketServer

T = TypeVar("T")


def served(path: Path, client: Callable[[], T]) -> T:
    """Run blocking `client` in a thread while the bus is served."""
    table = Turntable(rate_radps=0.5)

    async def main() -> T:
        loop = asyncio.get_running_loop()
        server = I2cSocketServer([gyro(table), hmc(table)], path, loop.time)
        await server.start()
        try:
            return await asyncio.to_thread(client)
        finally:
            await server.close()
            await server.close()

    outcome = asyncio.run(main())
    assert not path.exists()
    return outcome


def test_driver_over_the_socket_in_real_time(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    config = ImuConfig(bus=f"unix:{path}", rate_hz=100.0)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        table = Turntable(rate_radps=0.5)
        server = I2cSocketServer([gyro(table), hmc(table)], path, loop.time)
        await server.start()
        bus = await asyncio.to_thread(open_i2c_bus, config.bus)
        driver = ImuDriver(bus, config, loop.time)
        samples, threads = [], set()
        try:
            await driver.open()
            async for sample in driver.samples():
                samples.append(sample)
                threads |= {t.name for t in threading.enumerate() if "imu-i2c" in t.name}
                if len(samples) == 30:
                    break
        finally:
            driver.close()
            await server.close()
        assert len(threads) == 1
        assert all(s.yaw_rate_radps == pytest.approx(0.5, abs=2e-4) for s in samples)
        assert any(s.field_gauss is not None for s in samples)
        assert driver.health.gyro == "MPU-6050"
        took_s = samples[-1].stamp_s - samples[0].stamp_s
        assert took_s >= 0.29 - 1e-3

    asyncio.run(main())


def test_bus_reads_writes_and_missing_devices(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"

    def client() -> None:
        bus = open_i2c_bus(f"unix:{path}")
        assert bus.read(0x68, 0x75, 1) == b"\x68"
        bus.write(0x68, 0x19, b"\x04\x03")
        assert bus.read(0x68, 0x19, 2) == b"\x04\x03"
        with pytest.raises(OSError, match="Remote I/O") as failure:
            bus.read(0x29, 0, 1)
        assert failure.value.errno == errno.EREMOTEIO
        assert bus.read(0x1E, 10, 3) == b"H43"  # the line is still good
        bus.close()
        bus.close()
        assert bus.read(0x1E, 10, 3) == b"H43"  # and opens again by itself
        bus.close()

    served(path, client)


def test_bytes_on_the_socket_are_the_documented_ones(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"

    def client() -> None:
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(1.0)
            line.connect(str(path))
            line.sendall(bytes.fromhex("0500 52 68 75 0100"))
            assert line.recv(16) == bytes.fromhex("0200 00 68")
            line.sendall(bytes.fromhex("0400 57 68 6b 01"))
            assert line.recv(16) == bytes.fromhex("0100 00")
            line.sendall(bytes.fromhex("0500 52 29 00 0100"))
            assert line.recv(16) == bytes([1, 0, errno.EREMOTEIO])
            line.sendall(bytes.fromhex("0500 41 68 75 0100"))
            assert line.recv(16) == bytes([1, 0, errno.EPROTO])
            line.sendall(struct.pack("<H", 60_000))
            assert line.recv(16) == b""  # hung up

    served(path, client)


def test_two_clients_and_one_that_leaves_in_the_middle(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"

    def client() -> None:
        first, second = SocketBus(str(path)), SocketBus(str(path))
        with socket.socket(socket.AF_UNIX) as rude:
            rude.connect(str(path))
            rude.sendall(b"\x05\x00\x52")
        assert first.read(0x68, 0x75, 1) == second.read(0x68, 0x75, 1) == b"\x68"
        first.close()
        second.close()

    served(path, client)


def test_nobody_there(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"no emulated I2C bus answers.*ins-robot emulate"):
        open_i2c_bus(f"unix:{tmp_path / 'none.sock'}")
    with pytest.raises(
        DeviceError, match=r"cannot open this I2C bus: there is none.*raspi-config"
    ):
        open_i2c_bus(str(tmp_path / "i2c-9"))


def test_a_silent_server_is_an_oserror(tmp_path: Path) -> None:
    path = tmp_path / "silent.sock"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen(1)
        bus = SocketBus(str(path), timeout_s=0.05)
        with pytest.raises(TimeoutError):
            bus.read(0x68, 0x75, 1)
        bus.close()


def test_socket_left_behind_is_replaced_and_a_live_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    assert path.exists()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        server = I2cSocketServer([gyro(Turntable())], path, loop.time)
        await server.start()
        with pytest.raises(DeviceError, match="another emulator already serves"):
            await I2cSocketServer([], path, loop.time).start()
        await server.close()
        missing = I2cSocketServer([], tmp_path / "no" / "where.sock", loop.time)
        with pytest.raises(DeviceError, match="cannot make this socket"):
            await missing.start()

    asyncio.run(main())
