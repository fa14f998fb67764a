# SPDX-License-Identifier: MIT
"""The motor driver against the emulated microcontroller: wires good and bad, virtual time."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Coroutine
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from motor_line import COUNTS_PER_RAD, Mangle, dropping, joined, noisy, perfect

from ins_robot.errors import DeviceError
from ins_robot.firmware import motor_mcu as mcu
from ins_robot.simulation.virtual_clock import run_virtual

AHEAD = (-4.0, 0.5, 4.0)


def run(main: Coroutine[Any, Any, None]) -> None:
    run_virtual(main)


# What passes


@pytest.mark.parametrize("is_bytewise", [False, True])
def test_wheels_turn_as_told_and_samples_tell_it(is_bytewise: bool) -> None:
    async def main() -> None:
        async with joined(is_bytewise=is_bytewise) as line:
            samples = await line.drive(4.0, AHEAD)
            first, last = samples[100], samples[-1]
            seconds = last.device_s - first.device_s
            turned = np.subtract(last.counts, first.counts) / COUNTS_PER_RAD / seconds
            assert turned == pytest.approx(AHEAD, rel=0.01)
            assert len(samples) == pytest.approx(200, abs=2)
            assert {round(b.stamp_s - a.stamp_s, 6) for a, b in pairwise(samples)} == {0.02}
            assert {round(b.device_s - a.device_s, 6) for a, b in pairwise(samples)} == {0.02}
            assert last.battery_v == pytest.approx(12.0)
            assert last.fault == ""
            health = line.driver.health
            assert (health.lost_frames, health.rejected_frames) == (0, 0)
            assert (health.implausible_frames, health.mcu_refused_frames) == (0, 0)
            assert health.samples == len(samples)

    run(main())


def test_counts_and_time_start_at_zero_and_wrap_unnoticed() -> None:
    async def main() -> None:
        async with joined(first_ms=2**32 - 1500, first_counts=2**31 - 2000) as line:
            samples = await line.drive(4.0, (6.0, -6.0, 6.0))
            assert samples[0].counts == (0, 0, 0)
            assert samples[0].device_s == 0.0
            assert samples[-1].device_s == pytest.approx(4.0, abs=0.05)
            assert samples[-1].counts[0] > 10_000
            assert samples[-1].counts[1] == pytest.approx(-samples[-1].counts[0], abs=3)
            steps = np.diff([sample.counts[0] for sample in samples])
            assert np.all((steps >= 0) & (steps < 120))

    run(main())


@pytest.mark.parametrize("signs", [(1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)])
def test_the_wiring_is_known_to_the_driver_alone(signs: tuple[float, float, float]) -> None:
    """However the motors are wired, the body turns as asked and the counts say so."""

    async def main() -> None:
        async with joined(signs=signs) as line:
            samples = await line.drive(2.0, AHEAD)
            assert line.body.speeds_radps == pytest.approx(AHEAD, abs=0.05)
            assert np.sign(samples[-1].counts) == pytest.approx(np.sign(AHEAD))

    run(main())


def test_the_wire_carries_the_wiring_sign() -> None:
    async def main() -> None:
        told = bytearray()

        def note(data: bytes) -> bytes:
            told.extend(data)
            return data

        async with joined(signs=(-1.0, 1.0, 1.0), to_device=note) as line:
            line.driver.set_wheel_speeds((1.0, 2.0, -3.0))
            payloads = [
                p
                for kind, _, p in mcu.FrameDecoder().feed(bytes(told))
                if kind == mcu.SET_POINT
            ]
            assert struct.unpack("<iiiH", payloads[-1]) == (-1000, 2000, -3000, 200)

    run(main())


def test_inputs_arrive_as_they_are() -> None:
    async def main() -> None:
        async with joined() as line:
            for name in ("bumper", "cliff", "emergency_stop"):
                line.body.set_inputs(**{name: True})
                sample = (await line.drive(0.1))[-1]
                flags = {
                    "bumper": sample.bumper,
                    "cliff": sample.cliff,
                    "emergency_stop": sample.emergency_stop,
                }
                assert flags == {other: other == name for other in flags}

    run(main())


def test_a_battery_that_is_not_measured_is_nan() -> None:
    async def main() -> None:
        async with joined() as line:
            line.body.inputs_now = line.body.inputs_now._replace(battery_v=math.nan)
            assert math.isnan((await line.drive(0.1))[-1].battery_v)

    run(main())


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_speed_that_is_no_number_is_not_sent(bad: float) -> None:
    async def main() -> None:
        async with joined() as line:
            with pytest.raises(ValueError, match="not finite"):
                line.driver.set_wheel_speeds((1.0, bad, 1.0))
            assert line.driver.health.set_points == 0

    run(main())


# Bad wires


@pytest.mark.parametrize(
    ("to_device", "to_host"),
    [
        pytest.param(perfect, dropping(150, 1), id="drops to the host"),
        pytest.param(dropping(150, 2), perfect, id="drops to the device"),
        pytest.param(dropping(150, 3), dropping(150, 4), id="drops both ways"),
        pytest.param(noisy(5), noisy(6), id="noise both ways"),
    ],
)
def test_a_bad_wire_costs_counters_and_never_a_wrong_sample(
    to_device: Mangle, to_host: Mangle
) -> None:
    async def main() -> None:
        async with joined(to_device=to_device, to_host=to_host) as line:
            samples = await line.drive(20.0, AHEAD)
            health = line.driver.health
            assert samples[-1].fault == ""  # ten in a row are never lost
            assert health.rejected_frames + health.mcu_refused_frames > 50
            assert len(samples) + health.lost_frames == pytest.approx(1000, abs=3)
            assert len(samples) > 600
            # Whatever was lost, the totals are those of the wheels.
            assert samples[-1].counts == pytest.approx(line.body.counts(), abs=60)
            for a, b in pairwise(samples):
                assert 0.0 < b.device_s - a.device_s < 0.5
                assert a.stamp_s <= b.stamp_s
                turned = np.subtract(b.counts, a.counts) / COUNTS_PER_RAD
                assert np.all(np.abs(turned) <= 4.6 * (b.device_s - a.device_s) + 0.01)

    run(main())


def test_a_wire_that_loses_every_fifth_byte_stops_the_robot_and_says_so() -> None:
    async def main() -> None:
        async with joined() as line:
            await line.drive(1.0, AHEAD)
            line.wire.to_device, line.wire.to_host = dropping(5, 7), dropping(5, 8)
            with pytest.raises(
                DeviceError, match=r"no telemetry on /dev/ins-motors for 0\.5 s"
            ):
                await line.drive(60.0, AHEAD)
            await asyncio.sleep(1.0)
            assert line.body.speeds_radps == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
            # The wire is mended: the fault is still there, and can be cleared.
            line.wire.to_device = line.wire.to_host = perfect
            assert (await line.drive(0.1))[-1].fault == "dead_man"

    run(main())


def test_opening_gets_through_a_bad_wire() -> None:
    async def main() -> None:
        async with joined(to_device=dropping(30, 9), to_host=noisy(10)) as line:
            assert (await line.drive(1.0, AHEAD))[-1].fault == ""

    run(main())


def test_stamps_are_steadier_than_arrivals() -> None:
    """Telemetry held back by up to 15 ms, in whole frames, as a busy USB host does."""

    async def main() -> None:
        rng = np.random.default_rng(11)
        held = bytearray()

        def hold(data: bytes) -> bytes:
            held.extend(data)
            if rng.random() < 0.5:
                return b""
            released, held[:] = bytes(held), b""
            return released

        async with joined(to_host=hold) as line:
            samples = (await line.drive(20.0, AHEAD))[100:]
            errors = [s.stamp_s - s.device_s for s in samples]
            assert np.std(errors) < 0.5e-3

    run(main())
