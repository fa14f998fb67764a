# SPDX-License-Identifier: MIT
"""The real driver on emulated chips, on virtual time, with good and bad buses."""

from __future__ import annotations

import asyncio
import errno
import logging
import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from imu_bench import EXACT, FaultyBus, Turntable, gyro, hmc, qmc

from ins_robot.config import ImuConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import ImuSample
from ins_robot.sensing.drivers.imu import FAILURES_MAX, ImuDriver
from ins_robot.simulation.virtual_clock import run_virtual

Step = Callable[[FaultyBus, int], None]


def run(
    devices: list[object], count: int, config: ImuConfig | None = None, step: Step | None = None
) -> tuple[list[ImuSample], ImuDriver, FaultyBus]:
    """`count` samples; `step(bus, k)` may break something after the k-th."""

    async def main() -> tuple[list[ImuSample], ImuDriver, FaultyBus]:
        clock = asyncio.get_running_loop().time
        bus = FaultyBus(devices, clock)
        driver = ImuDriver(bus, config or ImuConfig(), clock)
        samples: list[ImuSample] = []
        try:
            await driver.open()
            async for sample in driver.samples():
                samples.append(sample)
                if len(samples) == count:
                    break
                if step is not None:
                    step(bus, len(samples))
        finally:
            driver.close()
        return samples, driver, bus

    return run_virtual(main())


def open_only(devices: list[object], config: ImuConfig | None = None) -> ImuDriver:
    _samples, driver, _bus = run(devices, 1, config)
    return driver


def test_rate_scale_sign_temperature_and_pace() -> None:
    table = Turntable(rate_radps=0.5)
    config = ImuConfig(gyro_sign=-1.0, gyro_scale=1.02)
    samples, driver, bus = run([gyro(table), hmc(table)], 200, config)
    assert samples[0].yaw_rate_radps == pytest.approx(-0.5 * 1.02, abs=2e-4)
    assert samples[0].temperature_c == pytest.approx(30.0, abs=0.01)
    # Drift-free: the 200th comes 199 periods after the first.
    assert samples[-1].stamp_s - samples[0].stamp_s == pytest.approx(199 / 50, abs=1e-9)
    assert driver.health.samples == 200
    assert driver.health.missed_ticks == 0
    assert bus.is_closed


@pytest.mark.parametrize("chip", [hmc, qmc])
def test_field_comes_in_the_base_frame_and_never_twice(chip: Callable[..., object]) -> None:
    table = Turntable(field=(0.2, 0.1, -0.4))
    yaw = math.radians(30.0)
    config = ImuConfig(compass_yaw_deg=30.0)
    samples, driver, bus = run([gyro(table), chip(table, EXACT, yaw)], 200, config)
    fields = [s.field_gauss for s in samples if s.field_gauss is not None]
    assert 40 <= len(fields) <= 50  # every fourth tick: 80 ms, measured every 67 ms
    for field in fields:
        assert field == pytest.approx((0.2, 0.1, -0.4), abs=2e-3)
    compass_reads = [t for t in bus.transfers if t[0] == "read" and t[1] != 0x68]
    assert len(compass_reads) < 120  # status and data, not on every tick
    assert driver.health.compass in ("HMC5883L", "QMC5883L")


def test_without_a_compass_it_warns_and_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    samples, driver, _bus = run([gyro(Turntable())], 20)
    assert all(s.field_gauss is None for s in samples)
    assert driver.health.compass == ""
    assert "neither an HMC5883L (0x1e) nor a QMC5883L (0x0d)" in caplog.text


def test_compass_switched_off_is_not_touched(caplog: pytest.LogCaptureFixture) -> None:
    table = Turntable()
    _samples, _driver, bus = run([gyro(table), hmc(table)], 20, ImuConfig(use_compass=False))
    assert {address for _kind, address, _register in bus.transfers} == {0x68}
    assert caplog.text == ""


def test_a_floating_bus_is_no_qmc() -> None:
    """Its chip id is 0xFF, and so is nothing at all: only what can be written counts."""

    class Floating:
        address = 0x0D

        def read(self, register: int, length: int, now_s: float) -> bytes:
            return b"\xff" * length

        def write(self, register: int, data: bytes, now_s: float) -> None:
            pass

    assert open_only([gyro(Turntable()), Floating()]).health.compass == ""


def test_clone_is_named(caplog: pytest.LogCaptureFixture) -> None:
    driver = open_only([gyro(Turntable(), who_am_i=0x98)])
    assert driver.health.gyro == "ICM-20689"
    assert "a clone, ICM-20689" in caplog.text


@pytest.mark.parametrize(
    ("who", "cause"),
    [(0x00, "held low"), (0xFF, "wiring or pull-ups"), (0x0E, "DS3231")],
)
def test_another_chip_is_refused(who: int, cause: str) -> None:
    with pytest.raises(DeviceError, match=f"WHO_AM_I is 0x{who:02x}, expected 0x68.*{cause}"):
        open_only([gyro(Turntable(), who_am_i=who)])


def test_no_chip_is_refused() -> None:
    with pytest.raises(DeviceError, match=r"gyro at 0x69 on /dev/i2c-1: no answer 3 times"):
        open_only([gyro(Turntable())], ImuConfig(gyro_address=0x69))


def test_settings_that_do_not_stick_are_refused() -> None:
    chip = gyro(Turntable())
    write = chip.write

    def forgetful(register: int, data: bytes, now_s: float) -> None:
        if register != 0x1A:
            write(register, data, now_s)

    chip.write = forgetful  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match=r"register 0x1a reads 0x00 after 0x03 was written"):
        open_only([chip])


def test_sporadic_errors_cost_a_sample_each() -> None:
    def every_tenth(bus: FaultyBus, k: int) -> None:
        bus.failures = 1 if k % 10 == 0 else 0

    samples, driver, _bus = run([gyro(Turntable(rate_radps=0.3))], 100, step=every_tenth)
    assert driver.health.bus_errors == 9
    assert driver.health.set_up_again == 0
    assert all(s.yaw_rate_radps == pytest.approx(0.3, abs=2e-4) for s in samples)


@pytest.mark.parametrize("with_error", [True, False])
def test_a_power_dip_is_healed(with_error: bool, caplog: pytest.LogCaptureFixture) -> None:
    """Chips back asleep, with or without a failed transfer: no zero rate gets through."""
    table = Turntable(rate_radps=0.3)
    chip, compass = gyro(table), hmc(table)

    def dip(bus: FaultyBus, k: int) -> None:
        if k == 50:
            chip.power_on()
            compass.power_on()
            bus.failures = int(with_error)

    caplog.set_level(logging.WARNING)
    samples, driver, _bus = run([chip, compass], 150, step=dip)
    assert driver.health.set_up_again == 1
    assert all(s.yaw_rate_radps == pytest.approx(0.3, abs=2e-4) for s in samples)
    gap_s = max(b.stamp_s - a.stamp_s for a, b in pairwise(samples))
    assert gap_s < 0.2
    assert any(s.field_gauss is not None for s in samples[100:])
    assert "lost its settings" in caplog.text


def test_a_dead_gyro_ends_the_stream() -> None:
    def die(bus: FaultyBus, k: int) -> None:
        if k == 10:
            bus.dead.add(0x68)

    with pytest.raises(DeviceError, match=f"no answer {FAILURES_MAX} times in a row"):
        run([gyro(Turntable())], 1000, step=die)


def test_a_dead_compass_does_not(caplog: pytest.LogCaptureFixture) -> None:
    def die(bus: FaultyBus, k: int) -> None:
        if k == 10:
            bus.dead.add(0x1E)

    table = Turntable()
    samples, driver, _bus = run([gyro(table), hmc(table)], 200, step=die)
    assert len(samples) == 200
    assert all(s.field_gauss is None for s in samples[100:])
    assert driver.health.compass == ""
    assert "HMC5883L lost" in caplog.text


def test_saturated_rate_is_left_out() -> None:
    table = Turntable()

    async def main() -> ImuDriver:
        clock = asyncio.get_running_loop().time
        driver = ImuDriver(FaultyBus([gyro(table)], clock), ImuConfig(use_compass=False), clock)
        await driver.open()

        async def stop_spinning() -> None:
            await asyncio.sleep(0.1)
            table.rate_radps = 5.0
            await asyncio.sleep(0.1)
            table.rate_radps = 0.0

        task = asyncio.create_task(stop_spinning())
        rates = []
        async for sample in driver.samples():
            rates.append(sample.yaw_rate_radps)
            if len(rates) == 30:
                break
        await task
        driver.close()
        assert max(rates) < 0.01
        return driver

    assert 3 <= run_virtual(main()).health.saturated <= 6


def test_overflowing_compass_widens_its_range() -> None:
    """A strong motor near: 3 gauss is too much for gains 1 and 2, counted five times each."""
    table = Turntable(field=(3.0, 0.0, 0.4))
    samples, driver, bus = run([gyro(table), hmc(table)], 200)
    fields = [s.field_gauss for s in samples if s.field_gauss is not None]
    assert fields
    assert all(f == pytest.approx((3.0, 0.0, 0.4), abs=0.01) for f in fields)
    assert driver.health.compass_overflows == 10
    gains = [t for t in bus.transfers if t == ("write", 0x1E, 0x01)]
    assert len(gains) == 1 + 2


def test_late_ticks_are_left_out_not_caught_up() -> None:
    """A consumer that stalls for 0.25 s gets no burst of old ticks afterwards."""

    async def main() -> tuple[list[float], ImuDriver]:
        clock = asyncio.get_running_loop().time
        driver = ImuDriver(FaultyBus([gyro(Turntable())], clock), ImuConfig(), clock)
        await driver.open()
        stamps: list[float] = []
        async for sample in driver.samples():
            stamps.append(sample.stamp_s)
            if len(stamps) == 5:
                await asyncio.sleep(0.25)
            if len(stamps) == 20:
                break
        driver.close()
        return stamps, driver

    stamps, driver = run_virtual(main())
    steps = [b - a for a, b in pairwise(stamps)]
    assert min(steps) >= 0.0099
    assert driver.health.missed_ticks in (11, 12)
    assert stamps[-1] - stamps[-2] == pytest.approx(0.02, abs=1e-9)


def test_a_hanging_bus_is_reported() -> None:
    """On the real loop: the thread is stuck, the loop is not."""

    async def main() -> None:
        import threading

        import ins_robot.sensing.drivers.imu as module

        release = threading.Event()

        class HangingBus(FaultyBus):
            def read(self, address: int, register: int, length: int) -> bytes:
                release.wait(5.0)
                raise OSError(errno.ETIMEDOUT, "Connection timed out")

        old_s, module.BUS_TIMEOUT_S = module.BUS_TIMEOUT_S, 0.05
        loop = asyncio.get_running_loop()
        driver = ImuDriver(HangingBus([], loop.time), ImuConfig(), loop.time)
        try:
            with pytest.raises(DeviceError, match="a transfer hangs"):
                await driver.open()
        finally:
            driver.close()
            driver.close()
            release.set()
            module.BUS_TIMEOUT_S = old_s

    asyncio.run(main())


def test_the_adapters_own_timeout_is_an_error_like_others() -> None:
    """ETIMEDOUT is a TimeoutError in Python, as asyncio's is: not to be confused."""
    table = Turntable()

    def time_out(bus: FaultyBus, k: int) -> None:
        if k == 5:
            device = bus._device(0x68)
            read = device.read

            def once(register: int, length: int, now_s: float) -> bytes:
                device.read = read
                raise OSError(errno.ETIMEDOUT, "Connection timed out")

            device.read = once

    samples, driver, _bus = run([gyro(table)], 20, step=time_out)
    assert len(samples) == 20
    assert driver.health.bus_errors == 1
