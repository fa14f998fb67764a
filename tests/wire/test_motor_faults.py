# SPDX-License-Identifier: MIT
"""The motor driver and the emulated microcontroller: faults, failures, the wrong port."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import numpy as np
import pytest
from motor_line import Mangle, dropping, joined, noisy

from ins_robot.errors import DeviceError, StateError
from ins_robot.firmware import motor_mcu as mcu
from ins_robot.sensing.drivers.motor_codec import MotorCodec
from ins_robot.simulation.virtual_clock import run_virtual

AHEAD = (-4.0, 0.5, 4.0)


def run(main: Coroutine[Any, Any, None]) -> None:
    run_virtual(main)


# Faults


@pytest.mark.parametrize("name", ["bumper", "cliff", "emergency_stop"])
def test_a_latched_fault_surfaces_and_goes_by_rearm_alone(name: str) -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(1.0, AHEAD)
            line.body.set_inputs(**{name: True})
            pressed = (await line.drive(0.5, AHEAD))[-1]
            assert pressed.fault == name
            assert line.body.speeds_radps == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
            with pytest.raises(StateError, match=f"fault '{name}' cannot be cleared"):
                await while_reading(line.driver.rearm(), line)
            line.body.set_inputs()
            assert (await line.drive(0.5, AHEAD))[-1].fault == name
            await while_reading(line.driver.rearm(), line)
            assert (await line.drive(1.0, AHEAD))[-1].fault == ""
            assert line.body.speeds_radps == pytest.approx(AHEAD, abs=0.05)

    run(main())


async def while_reading(action: Coroutine[Any, Any, None], line: Any) -> None:
    """Await an action of the driver while its samples are read, as in the daemon."""

    async def read() -> None:
        async for _ in line.driver.samples():
            line.driver.stop()

    reader = asyncio.get_running_loop().create_task(read())
    try:
        await action
    finally:
        reader.cancel()
        await asyncio.wait([reader])


def test_rearm_gets_through_a_bad_wire() -> None:
    async def main() -> None:
        async with joined() as line:
            line.body.set_inputs(bumper=True)
            await line.drive(0.2)
            line.body.set_inputs()
            line.wire.to_device, line.wire.to_host = dropping(15, 12), dropping(40, 13)
            await while_reading(line.driver.rearm(), line)

    run(main())


def test_rearm_without_a_fault_sends_nothing() -> None:
    async def main() -> None:
        sent: list[bytes] = []
        async with joined() as line:
            await line.drive(0.1)
            line.wire.to_device = lambda data: sent.append(data) or data
            await line.driver.rearm()
            assert sent == []

    run(main())


def test_a_host_that_hangs_while_driving_finds_a_dead_man_fault() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(1.0, AHEAD)
            await asyncio.sleep(0.6)
            assert line.body.speeds_radps == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
            sample = (await line.drive(0.1))[-1]
            assert sample.fault == "dead_man"
            assert line.driver.health.mcu_dead_man_stops == 1

    run(main())


def test_closing_while_driving_stops_the_wheels_without_a_fault() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(1.0, AHEAD)
            line.driver.close()
            line.driver.close()
            await asyncio.sleep(0.02)
            sent = b""
            for step in range(100):  # the pump's stream is closed: live on by hand
                sent += line.emulator.advance(asyncio.get_running_loop().time() + step * 0.01)
            assert line.body.speeds_radps == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
            last = MotorCodec().feed(sent)[-1]
            assert getattr(last, "fault", None) == ""

    run(main())


# A line that is not, or no longer, the microcontroller's


def test_silence_is_an_error_after_its_timeout() -> None:
    async def main() -> None:
        async with joined(silence_timeout_s=0.3) as line:
            await line.drive(0.5)
            line.wire.to_host = lambda data: b""
            since_s = asyncio.get_running_loop().time()
            with pytest.raises(
                DeviceError, match=r"no telemetry on .* for 0.3 s: cable, power"
            ):
                await line.drive(60.0)
            assert asyncio.get_running_loop().time() - since_s == pytest.approx(0.3, abs=0.05)

    run(main())


def test_noise_alone_is_silence() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(0.5)
            rng = np.random.default_rng(14)
            line.wire.to_host = lambda data: rng.bytes(20)
            with pytest.raises(DeviceError, match="no telemetry"):
                await line.drive(60.0)

    run(main())


def test_a_line_that_closes_is_an_error() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(0.1)
            line.stream.close()
            with pytest.raises(DeviceError, match="has gone"):
                await line.drive(1.0)
            with pytest.raises(DeviceError):
                line.driver.set_wheel_speeds(AHEAD)

    run(main())


def test_a_microcontroller_that_restarts_is_told_apart_from_one_that_stands() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(1.0, AHEAD)
            line.emulator.restart()
            with pytest.raises(DeviceError, match="restarted by itself"):
                await line.drive(1.0, AHEAD)

    run(main())


def test_another_protocol_names_both() -> None:
    def other(data: bytes) -> bytes:
        frames = mcu.FrameDecoder().feed(data)
        return b"".join(
            mcu.encode_frame(
                kind, seq, bytes([7, 2, 0, 1]) if kind == mcu.HELLO_REPLY else payload
            )
            for kind, seq, payload in frames
        )

    async def main() -> None:
        async with joined(to_host=other, is_open=False) as line:
            with pytest.raises(
                DeviceError, match=r"firmware 2\.0\.1\) speaks protocol 7, this host protocol 1"
            ):
                await line.driver.open()

    run(main())


@pytest.mark.parametrize(
    ("to_host", "words"),
    [
        pytest.param(lambda data: b"", "no answer on /dev/ins-motors within 4 s", id="silent"),
        pytest.param(
            lambda data: b"\xfa\xa0\x00\x32" * 20,
            "bytes came, but no answer",
            id="another device",
        ),
    ],
)
def test_the_wrong_port_is_told(to_host: Mangle, words: str) -> None:
    async def main() -> None:
        async with joined(to_host=to_host, is_open=False) as line:
            with pytest.raises(DeviceError, match=words):
                await line.driver.open()

    run(main())


def test_a_configuration_that_is_not_taken_is_told() -> None:
    async def main() -> None:
        # 10 ms: shorter than the firmware's own loop can watch.
        async with joined(dead_man_s=0.01, is_open=False) as line:
            with pytest.raises(DeviceError, match="did not take its configuration"):
                await line.driver.open()

    run(main())


def test_the_same_session_gives_the_same_samples() -> None:
    def session() -> list[Any]:
        async def main() -> list[Any]:
            async with joined(to_device=noisy(15), to_host=dropping(60, 16)) as line:
                return await line.drive(5.0, AHEAD)

        return run_virtual(main())

    assert session() == session()
