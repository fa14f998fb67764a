# SPDX-License-Identifier: MIT
"""The LRF's driver and the emulated sensor, talking bytes on virtual time."""

import asyncio
import logging
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np
import pytest
from lrf_line import ClockOptics, StandingOptics, lrf_line, range_by_bearing_m

from ins_robot.config import LrfConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import LaserScan
from ins_robot.sensing.drivers.lrf import LrfDriver
from ins_robot.sensing.scan_filter import combine
from ins_robot.simulation.emulators.lrf import LrfEmulator
from ins_robot.simulation.virtual_clock import run_virtual

T = TypeVar("T")


def emulator(seed: int = 0, **options: Any) -> LrfEmulator:
    return LrfEmulator(StandingOptics(), np.random.default_rng(seed), **options)


def on_virtual_time(main: Coroutine[Any, Any, T]) -> T:
    return run_virtual(asyncio.wait_for(main, 120.0))


def degrees(scan: LaserScan) -> np.ndarray:
    return np.rint(np.degrees(scan.bearings_rad)).astype(int)


def test_a_scan_sees_the_room(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> tuple[list[LaserScan], Any]:
        async with lrf_line(emulator()) as line:
            assert not line.driver.is_motor_on
            return await line.scan(), line.driver.health

    caplog.set_level(logging.INFO)
    scans, health = on_virtual_time(main())
    for scan in [*scans, combine(scans, LrfConfig())]:
        lost = degrees(scan) % 10 == 0
        np.testing.assert_array_equal(scan.is_valid, ~lost)
        truth_m = range_by_bearing_m(scan.bearings_rad)
        np.testing.assert_allclose(scan.ranges_m[~lost], truth_m[~lost], atol=0.00051)
        weak = degrees(scan) % 10 == 5
        normal = ~weak & ~lost
        assert scan.range_std_m[weak].mean() > 1.3 * scan.range_std_m[normal].mean()
    assert health.controller_version == "1.4.0"
    assert "XV Lidar Controller, firmware 1.4.0" in caplog.text
    assert health.checksum_failures <= 1


@pytest.mark.parametrize(("yaw_deg", "is_clockwise"), [(-10.0, False), (40.0, True)])
def test_mounting_is_undone_by_the_configuration(yaw_deg: float, is_clockwise: bool) -> None:
    async def main() -> LaserScan:
        device = emulator(yaw_rad=np.radians(yaw_deg), is_clockwise=is_clockwise)
        config = LrfConfig(yaw_deg=yaw_deg, is_clockwise=is_clockwise)
        async with lrf_line(device, config) as line:
            return (await line.scan(1))[0]

    scan = on_virtual_time(main())
    seen = scan.is_valid
    assert seen.sum() == 324
    truth_m = range_by_bearing_m(scan.bearings_rad)
    np.testing.assert_allclose(scan.ranges_m[seen], truth_m[seen], atol=0.00051)


def test_beam_times_are_true_within_milliseconds_speed_ripple_and_all() -> None:
    async def main() -> list[LaserScan]:
        device = LrfEmulator(ClockOptics(), np.random.default_rng(5), rpm_ripple=0.003)
        async with lrf_line(device) as line:
            return await line.scan(12)

    for scan in on_virtual_time(main()):
        told_s = scan.stamp_s + scan.beam_offsets_s
        error_s = (told_s - (scan.ranges_m - 1.0) + 2.0) % 4.0 - 2.0
        assert np.abs(error_s).max() < 0.004
        assert abs(error_s.mean()) < 0.003


def test_the_motor_turns_only_while_scanning_and_old_data_is_dropped(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        optics = StandingOptics()
        device = LrfEmulator(optics, np.random.default_rng(0))
        async with lrf_line(device) as line:
            for _ in range(3):
                start_s = asyncio.get_running_loop().time()
                scans = await line.scan()
                assert asyncio.get_running_loop().time() - start_s < 3.0
                assert scans[0].stamp_s > start_s
                await asyncio.sleep(2.0)  # spins down; banner; nobody reads
                looks = len(optics.stamps_s)
                await asyncio.sleep(2.0)
                assert len(optics.stamps_s) == looks
            assert line.driver.health.sensor_restarts >= 2
            assert line.driver.health.sensor_version == "V2.4.13386"
            assert line.driver.health.motor_restarts == 0

    on_virtual_time(main())
    assert "with the motor on" not in caplog.text  # the banner of the last stop was dropped


def test_a_reader_that_runs_all_the_time_sees_every_motor_period() -> None:
    async def main() -> list[float]:
        stamps_s: list[float] = []

        async def read(driver: LrfDriver) -> None:
            async for revolution in driver.revolutions():
                stamps_s.append(revolution.stamp_s)

        async with lrf_line(emulator()) as line:
            reader = asyncio.create_task(read(line.driver))
            for _ in range(2):
                await line.driver.motor_on()
                await asyncio.sleep(3.0)
                await line.driver.motor_off()
                await asyncio.sleep(3.0)
            line.driver.close()
            await reader  # ends by itself
        return stamps_s

    gaps_s = np.diff(on_virtual_time(main()))
    assert len(gaps_s) > 12
    assert (gaps_s > 3.0).sum() == 1
    assert np.median(gaps_s) == pytest.approx(0.3, abs=0.01)


def test_too_slow_beams_raise_the_set_speed_and_the_log_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> list[LaserScan]:
        async with lrf_line(emulator(slow_rpm=230.0)) as line:
            scans = await line.scan()
            assert line.driver.set_rpm == 250.0
            assert line.driver.health.motor_restarts == 0
            return scans

    scans = on_virtual_time(main())
    assert scans[-1].rpm == pytest.approx(250.0, rel=0.02)
    raised = [r.getMessage() for r in caplog.records if "set speed raised" in r.getMessage()]
    assert len(raised) == 2
    assert "'too slow' at 200 rpm: set speed raised to 225 rpm" in raised[0]
    assert "raised to 250 rpm" in raised[1]


def test_a_raised_set_speed_stays_when_its_confirmation_is_lost() -> None:
    async def main() -> tuple[float, float]:
        is_open = False

        def mangle(data: bytes) -> bytes:
            return data.replace(b"New RPM", b"N#w RPM") if is_open else data

        async with lrf_line(emulator(slow_rpm=210.0), mangle=mangle) as line:
            is_open = True
            await line.scan(1)
            line.stream.write(b"SaveConfig\n")  # any other line
            scans = await line.scan(1)
            return line.driver.set_rpm, scans[0].rpm

    assert on_virtual_time(main()) == (225.0, pytest.approx(225.0, rel=0.08))


def test_a_set_speed_the_controller_does_not_take_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> float:
        async with lrf_line(emulator(), LrfConfig(rpm=340.0, rpm_max=349.0)) as line:
            return line.driver.set_rpm

    assert on_virtual_time(main()) == 300.0
    assert "lrf.rpm = 340, but the controller takes 200..300 rpm" in caplog.text


def test_a_blocked_rotor_is_restarted_then_reported() -> None:
    async def main() -> float:
        async with lrf_line(emulator()) as line:
            await line.scan()
            line.emulator.block_rotor()
            start_s = asyncio.get_running_loop().time()
            with pytest.raises(DeviceError, match="after 2 restarts of the motor") as caught:
                await line.scan()
            assert "rotor blocked" in str(caught.value)
            assert "\n" not in str(caught.value)
            assert not line.driver.is_motor_on
            line.emulator.release_rotor()
            took_s = asyncio.get_running_loop().time() - start_s
            assert len(await line.scan()) == 5  # the next try works
            return took_s

    assert on_virtual_time(main()) < 15.0


def test_a_rotor_held_for_a_moment_comes_back_by_itself(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        async with lrf_line(emulator()) as line:
            await line.driver.motor_on()
            revolutions = line.driver.revolutions()
            for _ in range(5):
                await anext(revolutions)
            for _ in range(3):  # more often than restarts in a row are allowed
                line.emulator.block_rotor()
                asyncio.get_running_loop().call_later(1.0, line.emulator.release_rotor)
                for _ in range(8):
                    revolution = await anext(revolutions)
                assert revolution.rpm == pytest.approx(200.0, rel=0.05)
            assert line.driver.health.motor_restarts >= 3

    on_virtual_time(main())
    assert "motor switched on again" in caplog.text


def test_a_stall_shutdown_of_the_controller_is_undone() -> None:
    async def main() -> int:
        async with lrf_line(emulator()) as line:
            await line.driver.motor_on()
            revolutions = line.driver.revolutions()
            for _ in range(5):
                await anext(revolutions)
            line.stream.write(b"MotorOff\n")  # behind the driver's back
            for _ in range(8):
                await anext(revolutions)
            return line.driver.health.motor_restarts

    assert on_virtual_time(main()) == 1


def test_a_line_that_breaks_is_an_error() -> None:
    async def main() -> None:
        async with lrf_line(emulator()) as line:
            await line.driver.motor_on()
            line.stream.close()
            with pytest.raises(DeviceError, match="closed at the far end"):
                await anext(line.driver.revolutions())

    on_virtual_time(main())


def test_a_silent_line_is_an_error_that_names_the_port() -> None:
    class Dead(LrfEmulator):
        def advance(self, now_s: float) -> bytes:
            return b""

    async def main() -> None:
        dead = Dead(StandingOptics(), np.random.default_rng(0))
        async with lrf_line(dead, LrfConfig(port="/dev/ins-lrf")) as line:
            with pytest.raises(
                DeviceError, match=r"/dev/ins-lrf: no good packet for \d.*cable"
            ):
                await line.scan()

    on_virtual_time(main())


def test_old_sensor_firmware_is_refused_by_name() -> None:
    frame = b"\x5a\xa5\x00\xc0\x98\xd1" + bytes(1440)

    async def main() -> None:
        async with lrf_line(emulator(), mangle=lambda data: frame, is_opened=False) as line:
            with pytest.raises(DeviceError, match=r"unsupported firmware 2\.1"):
                await line.driver.open()

    on_virtual_time(main())


def test_a_bare_sensor_without_controller_works(caplog: pytest.LogCaptureFixture) -> None:
    class Deaf(LrfEmulator):
        def receive(self, data: bytes, now_s: float) -> None:
            pass

    async def main() -> list[LaserScan]:
        async with lrf_line(Deaf(StandingOptics(), np.random.default_rng(0))) as line:
            return await line.scan()

    assert len(on_virtual_time(main())) == 5
    assert "no XV Lidar Controller answers" in caplog.text


@pytest.mark.parametrize("fault", ["bit errors", "lost bytes", "noise", "chopped"])
def test_bad_wires_cost_packets_and_nothing_else(fault: str) -> None:
    rng = np.random.default_rng(7)

    def mangle(data: bytes) -> bytes:
        if not data or fault == "chopped":
            return data
        damaged = bytearray(data)
        if fault == "noise":
            at = int(rng.integers(len(data)))
            damaged[at:at] = rng.bytes(5)
        for at in np.flatnonzero(rng.random(len(data)) < 0.003)[::-1].tolist():
            if fault == "bit errors":
                damaged[at] ^= 1 << int(rng.integers(8))
            elif fault == "lost bytes":
                del damaged[at]
        return bytes(damaged)

    async def main() -> list[LaserScan]:
        async with lrf_line(emulator(), mangle=mangle) as line:
            return await line.scan()

    scan = combine(on_virtual_time(main()), LrfConfig())
    seen = scan.is_valid
    assert seen.sum() > 300
    assert not seen[degrees(scan) % 10 == 0].any()
    truth_m = range_by_bearing_m(scan.bearings_rad)
    np.testing.assert_allclose(scan.ranges_m[seen], truth_m[seen], atol=0.00051)


def test_a_scan_right_after_a_scan() -> None:
    async def main() -> int:
        async with lrf_line(emulator()) as line:
            await line.scan(2)
            scans = await line.scan(2)  # the rotor had no time to stop
            assert line.driver.health.sensor_restarts == 0
            return len(scans)

    assert on_virtual_time(main()) == 2


def test_closing_stops_the_motor_and_may_be_repeated() -> None:
    async def main() -> None:
        optics = StandingOptics()
        async with lrf_line(LrfEmulator(optics, np.random.default_rng(0))) as line:
            await line.driver.motor_on()
            await anext(line.driver.revolutions())
            line.driver.close()
            line.driver.close()
            await asyncio.sleep(2.0)
            looks = len(optics.stamps_s)
            await asyncio.sleep(1.0)
            assert len(optics.stamps_s) == looks

    on_virtual_time(main())


def test_the_same_seed_gives_the_same_scans() -> None:
    async def main(seed: int) -> list[float]:
        async with lrf_line(emulator(seed)) as line:
            return [scan.stamp_s for scan in await line.scan()]

    first, again, other = (on_virtual_time(main(seed)) for seed in (1, 1, 2))
    assert first == again != other
