# SPDX-License-Identifier: MIT
"""The motor microcontroller: what it obeys, when it stops, and what starts it again."""

from __future__ import annotations

import itertools
import struct

import pytest

from ins_robot.firmware import motor_mcu as mcu

COUNTS_PER_REV = 4096
FREE_RADPS = 12.0
PINS_OF_FAULT = {
    mcu.FAULT_BUMPER: mcu.BUMPER,
    mcu.FAULT_CLIFF: mcu.CLIFF,
    mcu.FAULT_EMERGENCY_STOP: mcu.EMERGENCY_STOP,
}


class Bench:
    """An MCU with three motors on the bench, and a hand on every pin."""

    def __init__(self, first_ms: int = 0, first_counts: int = 0, lag_s: float = 0.08) -> None:
        self.mcu = mcu.MotorMcu()
        self.inputs = 0
        self.speeds = [0.0, 0.0, 0.0]
        self.duties = (0.0, 0.0, 0.0)
        self.encoder_gains = [1.0, 1.0, 1.0]
        self.is_blocked = False
        self.frames: list[tuple[int, int, bytes]] = []
        self.now_ms = first_ms
        self._turned = [0.0, 0.0, 0.0]
        self._first_counts = first_counts
        self._lag_s = lag_s
        self._seq = 0
        self._decoder = mcu.FrameDecoder()

    def send(self, kind: int, layout: str, *values: int) -> None:
        self._seq += 1
        self.mcu.receive(mcu.encode_frame(kind, self._seq, struct.pack(layout, *values)))

    def configure(self, dead_man_ms: int = 200, counts: int = COUNTS_PER_REV) -> None:
        self.send(mcu.CONFIG, mcu.CONFIG_FORMAT, dead_man_ms, counts, 8000, 12000)

    def set_point(self, a: float, b: float, c: float, validity_ms: int = 200) -> None:
        mradps = (round(speed * 1000) for speed in (a, b, c))
        self.send(mcu.SET_POINT, mcu.SET_POINT_FORMAT, *mradps, validity_ms)

    def rearm(self, fault: int) -> None:
        self.send(mcu.REARM, mcu.REARM_FORMAT, fault)

    def run(self, ms: int, driving: tuple[float, float, float] | None = None) -> None:
        """Live on; with `driving`, a set point comes every 20 ms."""
        for i in range(ms // mcu.STEP_MS):
            if driving is not None and i % 2 == 0:
                self.set_point(*driving)
            for w in range(3):
                goal = 0.0 if self.is_blocked else self.duties[w] * FREE_RADPS
                self.speeds[w] += (goal - self.speeds[w]) * 0.01 / self._lag_s
                self._turned[w] += self.speeds[w] * 0.01 * self.encoder_gains[w]
            counts = [
                mcu.wrap32(self._first_counts + int(t * COUNTS_PER_REV / mcu.TURN_RAD))
                for t in self._turned
            ]
            self.duties = self.mcu.step(self.now_ms, tuple(counts), self.inputs, 12000)
            self.frames += self._decoder.feed(self.mcu.transmit())
            self.now_ms = self.now_ms + mcu.STEP_MS & 0xFFFFFFFF

    def telemetry(self) -> tuple[int, ...]:
        payload = [p for kind, _, p in self.frames if kind == mcu.TELEMETRY][-1]
        return struct.unpack(mcu.TELEMETRY_FORMAT, payload)

    @property
    def told_fault(self) -> int:
        return self.telemetry()[5]


@pytest.fixture
def bench() -> Bench:
    ready = Bench()
    ready.configure()
    ready.run(100)
    return ready


# What it obeys


def test_before_config_it_says_so_and_turns_nothing() -> None:
    bench = Bench()
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.told_fault == mcu.FAULT_NOT_CONFIGURED
    assert bench.duties == (0.0, 0.0, 0.0)
    bench.configure()
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.speeds == pytest.approx([4.0, 4.0, 4.0], rel=0.05)


def test_hello_is_answered_at_any_time() -> None:
    bench = Bench()
    bench.send(mcu.HELLO, mcu.HELLO_FORMAT, 99)
    bench.run(20)
    assert bench.frames[0][0] == mcu.HELLO_REPLY
    assert bench.frames[0][2] == bytes([mcu.PROTOCOL, *mcu.FIRMWARE])


@pytest.mark.parametrize(
    "values",
    [
        (0, 4096, 8000, 12000),
        (2001, 4096, 8000, 12000),
        (200, 0, 8000, 12000),
        (200, 4096, 0, 12000),
        (200, 4096, 8000, 0),
    ],
)
def test_a_config_that_cannot_be_is_refused(values: tuple[int, ...]) -> None:
    bench = Bench()
    bench.send(mcu.CONFIG, mcu.CONFIG_FORMAT, *values)
    bench.run(100)
    assert bench.told_fault == mcu.FAULT_NOT_CONFIGURED
    assert not [kind for kind, _, _ in bench.frames if kind == mcu.CONFIG_REPLY]
    assert bench.telemetry()[8] == 1  # frames refused


def test_telemetry_comes_at_50_hz_with_steady_time_and_sequence(bench: Bench) -> None:
    bench.frames.clear()
    bench.run(2000)
    told = [f for f in bench.frames if f[0] == mcu.TELEMETRY]
    assert len(told) == 100
    times = [struct.unpack(mcu.TELEMETRY_FORMAT, p)[0] for _, _, p in told]
    assert {b - a for a, b in itertools.pairwise(times)} == {20}
    assert {(b[1] - a[1]) & 0xFF for a, b in itertools.pairwise(told)} == {1}


def test_a_set_point_too_fast_is_scaled_as_a_whole(bench: Bench) -> None:
    bench.run(1000, driving=(16.0, -8.0, 4.0))
    assert bench.speeds == pytest.approx([8.0, -4.0, 2.0], rel=0.03)


@pytest.mark.parametrize(
    ("first_ms", "first_counts"),
    [(2**32 - 300, 2**31 - 200), (2**32 - 1600, -(2**31) + 200)],
    ids=["while driving", "in the silence after"],
)
def test_wrapping_time_and_counts_change_nothing(first_ms: int, first_counts: int) -> None:
    plain, wrapping = Bench(), Bench(first_ms, first_counts)
    for bench in (plain, wrapping):
        bench.configure()
        bench.run(1500, driving=(4.0, -2.0, 1.0))
        bench.run(500)
    assert wrapping.duties == plain.duties
    assert wrapping.speeds == pytest.approx(plain.speeds, abs=0.02)
    assert wrapping.told_fault == plain.told_fault == mcu.FAULT_DEAD_MAN
    for told, told_plain in zip(wrapping.telemetry()[1:4], plain.telemetry()[1:4], strict=True):
        assert abs(mcu.wrap32(told - first_counts) - told_plain) <= 20


# How the wheels follow


@pytest.mark.parametrize("lag_s", [0.04, 0.08, 0.15])
@pytest.mark.parametrize("speed", [0.5, 4.0, -8.0])
def test_a_wheel_reaches_its_set_point_without_swinging(lag_s: float, speed: float) -> None:
    bench = Bench(lag_s=lag_s)
    bench.configure()
    peak = 0.0
    for _ in range(100):
        bench.run(20, driving=(speed, 0.0, 0.0))
        peak = max(peak, bench.speeds[0] / speed)
    assert peak < 1.10
    assert bench.speeds[0] == pytest.approx(speed, abs=0.05)
    assert bench.speeds[1] == bench.speeds[2] == 0.0


def test_a_jump_of_the_set_point_becomes_a_ramp(bench: Bench) -> None:
    """40 rad/s2: a host without limits of its own does not shake the robot."""
    bench.run(100, driving=(8.0, 0.0, 0.0))
    assert 1.0 < bench.speeds[0] < 4.2


def test_a_blocked_wheel_winds_nothing_up(bench: Bench) -> None:
    bench.run(500, driving=(4.0, 4.0, 4.0))
    bench.is_blocked = True
    bench.run(300, driving=(4.0, 4.0, 4.0))
    bench.is_blocked = False
    peak = 0.0
    for _ in range(50):
        bench.run(20, driving=(4.0, 4.0, 4.0))
        peak = max(peak, bench.speeds[0])
    assert peak < 4.0 * 1.5
    assert bench.speeds[0] == pytest.approx(4.0, rel=0.05)


def test_at_rest_the_motors_are_quiet(bench: Bench) -> None:
    bench.run(500, driving=(4.0, 4.0, 4.0))
    bench.run(1000, driving=(0.0, 0.0, 0.0))
    assert bench.duties == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("gain", "what"), [(0.0, "unplugged"), (-1.0, "wired backwards")], ids=str
)
def test_a_wheel_with_a_bad_encoder_is_not_driven_on(
    bench: Bench, gain: float, what: str
) -> None:
    bench.encoder_gains[1] = gain
    bench.run(1500, driving=(2.0, 2.0, 2.0))
    assert bench.told_fault == mcu.FAULT_WHEEL, what
    assert bench.duties == (0.0, 0.0, 0.0)


# Dead-man


def test_driving_into_silence_stops_latches_and_counts(bench: Bench) -> None:
    bench.run(1000, driving=(4.0, -4.0, 2.0))
    bench.run(180)
    assert bench.told_fault == mcu.NO_FAULT
    bench.run(40)
    assert bench.told_fault == mcu.FAULT_DEAD_MAN
    bench.run(400)
    assert bench.speeds == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    assert bench.telemetry()[9] == 1
    # The host is back: nothing moves until it re-arms.
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.speeds == pytest.approx([0.0, 0.0, 0.0], abs=0.01)
    bench.rearm(mcu.FAULT_DEAD_MAN)
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.speeds == pytest.approx([4.0, 4.0, 4.0], rel=0.05)


def test_silence_at_rest_is_no_fault(bench: Bench) -> None:
    bench.run(1000, driving=(4.0, 4.0, 4.0))
    bench.run(100, driving=(0.0, 0.0, 0.0))
    bench.run(5000)
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.telemetry()[9] == 0


def test_a_set_point_lasts_no_longer_than_it_says(bench: Bench) -> None:
    bench.set_point(4.0, 4.0, 4.0, validity_ms=50)
    bench.run(50)
    assert bench.told_fault == mcu.NO_FAULT
    bench.run(40)
    assert bench.told_fault == mcu.FAULT_DEAD_MAN


def test_a_set_point_cannot_outlast_the_dead_man(bench: Bench) -> None:
    bench.set_point(4.0, 4.0, 4.0, validity_ms=60_000)
    bench.run(200)
    assert bench.told_fault == mcu.NO_FAULT
    bench.run(40)
    assert bench.told_fault == mcu.FAULT_DEAD_MAN


# Latches


@pytest.mark.parametrize("fault", PINS_OF_FAULT)
def test_an_input_latches_until_released_and_rearmed(bench: Bench, fault: int) -> None:
    bench.run(500, driving=(4.0, 4.0, 4.0))
    bench.inputs = PINS_OF_FAULT[fault]
    bench.run(10)  # one step is enough
    bench.inputs = 0
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.told_fault == fault
    assert bench.speeds == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    bench.rearm(fault)
    bench.run(500, driving=(4.0, 4.0, 4.0))
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.speeds == pytest.approx([4.0, 4.0, 4.0], rel=0.05)


@pytest.mark.parametrize("fault", PINS_OF_FAULT)
def test_an_input_still_on_cannot_be_rearmed(bench: Bench, fault: int) -> None:
    bench.inputs = PINS_OF_FAULT[fault]
    bench.run(100)
    for _ in range(20):
        bench.rearm(fault)
        bench.run(50, driving=(4.0, 4.0, 4.0))
        assert bench.told_fault == fault
    assert bench.speeds == [0.0, 0.0, 0.0]


def test_the_emergency_stop_outranks_what_was_latched(bench: Bench) -> None:
    """A re-arm meant for the bumper must not undo an emergency stop pressed in between."""
    bench.inputs = mcu.BUMPER
    bench.run(50)
    assert bench.told_fault == mcu.FAULT_BUMPER
    bench.inputs = mcu.EMERGENCY_STOP
    bench.run(10)
    bench.inputs = 0
    bench.rearm(mcu.FAULT_BUMPER)
    bench.run(50)
    assert bench.told_fault == mcu.FAULT_EMERGENCY_STOP


def test_a_bumper_that_is_still_on_comes_after_the_emergency_stop(bench: Bench) -> None:
    bench.inputs = mcu.EMERGENCY_STOP | mcu.BUMPER
    bench.run(50)
    bench.inputs = mcu.BUMPER
    bench.rearm(mcu.FAULT_EMERGENCY_STOP)
    bench.run(50)
    assert bench.told_fault == mcu.FAULT_BUMPER


def test_the_emergency_stop_takes_the_drive_away_at_once(bench: Bench) -> None:
    bench.run(500, driving=(4.0, 4.0, 4.0))
    bench.inputs = mcu.EMERGENCY_STOP
    bench.run(10)
    assert bench.duties == (0.0, 0.0, 0.0)


def test_a_bumper_brakes_harder_than_a_dead_man_stop() -> None:
    ways = {}
    for name in ("bumper", "dead man"):
        bench = Bench()
        bench.configure()
        bench.run(1000, driving=(4.0, 4.0, 4.0))
        if name == "bumper":
            bench.inputs = mcu.BUMPER
        else:
            bench.set_point(4.0, 4.0, 4.0, validity_ms=0)
            bench.run(10)
        before = bench._turned[0]
        bench.run(500)
        ways[name] = bench._turned[0] - before
    assert ways["bumper"] < 0.2  # rad: 1 cm at the rim
    assert ways["bumper"] < 0.5 * ways["dead man"] < 0.5


def test_a_set_point_from_before_the_rearm_starts_nothing(bench: Bench) -> None:
    bench.inputs = mcu.BUMPER
    bench.run(50)
    bench.inputs = 0
    bench.set_point(4.0, 4.0, 4.0)
    bench.rearm(mcu.FAULT_BUMPER)
    bench.run(150)
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.speeds == [0.0, 0.0, 0.0]


def test_a_restart_of_the_host_finds_the_fault_still_latched(bench: Bench) -> None:
    bench.inputs = mcu.CLIFF
    bench.run(50)
    bench.inputs = 0
    bench.configure()
    bench.run(50)
    assert bench.told_fault == mcu.FAULT_CLIFF


def test_a_new_config_stops_the_wheels(bench: Bench) -> None:
    bench.run(500, driving=(4.0, 4.0, 4.0))
    bench.configure()
    bench.run(1000)
    assert bench.told_fault == mcu.NO_FAULT
    assert bench.speeds == pytest.approx([0.0, 0.0, 0.0], abs=0.01)


def test_with_nobody_listening_the_newest_telemetry_is_kept(bench: Bench) -> None:
    for _ in range(1000):
        bench.mcu.step(bench.now_ms, (0, 0, 0), 0, 12000)
        bench.now_ms += 10
        assert len(bench.mcu._sending) < mcu.SEND_QUEUE_MAX + 2 * mcu.ENCODED_MAX
    (*_, (_, _, last)) = mcu.FrameDecoder().feed(bench.mcu.transmit())
    assert struct.unpack(mcu.TELEMETRY_FORMAT, last)[0] >= bench.now_ms - 30
