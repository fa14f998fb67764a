# SPDX-License-Identifier: MIT
"""The emulated XV-11 and its controller: replies to the byte, quirks of the real ones."""

import re

import numpy as np
import pytest
from lrf_line import StandingOptics

from ins_robot.sensing.drivers.lrf_codec import LrfCodec
from ins_robot.simulation.emulators.lrf import LrfEmulator

TICK_S = 0.02


def emulator(**options: float) -> LrfEmulator:
    return LrfEmulator(StandingOptics(), np.random.default_rng(0), **options)


def quiet() -> LrfEmulator:
    """One with motor and raw data off, at 5 s."""
    device = emulator()
    device.receive(b"HideRaw\nMotorOff\n", 0.0)
    for tick in range(250):
        device.advance(tick * TICK_S)
    return device


def ask(device: LrfEmulator, command: bytes, now_s: float = 5.0) -> bytes:
    device.receive(command, now_s)
    return device.advance(now_s)


def run(device: LrfEmulator, from_s: float, to_s: float, tick_s: float = TICK_S) -> bytes:
    """Poll it after `from_s` up to and with `to_s`."""
    count = round((to_s - from_s) / tick_s)
    return b"".join(device.advance(from_s + tick_s * k) for k in range(1, count + 1))


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        (b"SetRPM 250\n", b"Old RPM setpoint:200.00\r\nNew RPM setpoint: 250.00\r\n"),
        (
            b"SetRPM 150\n",
            b" \r\nRPM too low. Setting to minimum 200.00\r\n"
            b"Old RPM setpoint:200.00\r\nNew RPM setpoint: 200.00\r\n",
        ),
        (
            b"SetRPM 349\n",
            b" \r\nRPM too high. Setting to maximum 300.00\r\n"
            b"Old RPM setpoint:200.00\r\nNew RPM setpoint: 300.00\r\n",
        ),
        (b"SetRPM\n", b" \r\nIncorrect syntax.  Example: SetRPM 200\r\n"),
        (b"MotorOff\n", b" \r\nMotor off\r\n"),
        (b"MotorOn\n", b" \r\nMotor on\r\n"),
        (b"SaveConfig\n", b"Config Saved.\r\n"),
        (b"SetKp 2\n", b" \r\nSetting Kp to: 2.00\r\n"),
        (b"SetSampleTime 20\n", b" \r\nSetting Sample time to: 20.00\r\n"),
        (b"HideRaw\n", b""),
        (b"ResetConfig\n", b""),
        (b"ShowRaw\n", b" \r\nHiding Distance data\r\n \r\nHiding RPM data\r\n"),
        (b"ShowRPM\n", b" \r\nShowing RPM data\r\n"),
        (b"ShowErrors\n", b" \r\nShowing errors\r\n"),
        (b"ShowDist\n", b" \r\nCode,Angle,Distance(mm),Signal strength\r\n"),
        (
            b"SetAngle 0, 15-17\n",
            b"\r\nAngles:0,15,16,17,\r\n \r\nCode,Angle,Distance(mm),Signal strength\r\n",
        ),
        (b"motoroff\n", b" \r\nMotor off\r\n"),
        (b"MOTOROFF\r\n", b" \r\nMotor off\r\n"),
        (b"  MotorOff  \n", b" \r\nMotor off\r\n"),
        (b"MotorOff\r", b""),
        (b"GetVersion\n", b""),
        (b"RelayOff\nNonsense 1 2\n\n", b""),
        (b"x" * 300 + b"\nMotorOff\n", b" \r\nMotor off\r\n"),
    ],
)
def test_replies_to_the_byte(command: bytes, reply: bytes) -> None:
    assert ask(quiet(), command) == reply


def test_show_config_is_the_real_one_and_stops_the_raw_data() -> None:
    device = emulator()
    run(device, 0.0, 2.0)
    lines = ask(device, b"ShowConfig\n", 2.0).split(b"\r\n")
    start = next(i for i, line in enumerate(lines) if b"Firmware" in line)
    assert lines[start] == b"XV Lidar Controller Firmware Version 1.4.0"
    assert lines[start + 1 : start + 6] == [
        b"GetSurreal.com ",
        b" ",
        b"PWM pin: 4",
        b"Target RPM: 200.00",
        b"Max PWM: 1023.00",
    ]
    assert b"SampleTime: 20" in lines
    assert b"Motor Enable: 1" in lines
    assert b"Show Raw Data: 0" in lines
    angles = next(line for line in lines if line.startswith(b"Show Angle(s): "))
    assert angles == b"Show Angle(s): " + b",".join(b"%d" % i for i in range(360)) + b", "
    assert run(device, 2.0, 3.0) == b""


def test_commands_may_come_in_pieces() -> None:
    device = quiet()
    for byte in b"SetRPM 2":
        assert ask(device, bytes([byte])) == b""
    assert b"New RPM setpoint: 210.00" in ask(device, b"10\n")


def test_replies_land_between_and_inside_the_packets() -> None:
    device = emulator()
    data = run(device, 0.0, 2.0, 0.001)
    for tick in range(50):
        device.receive(b"MotorOn\n", 2.0 + 0.0011 * tick)
        data += device.advance(2.0 + 0.0011 * tick)
    codec = LrfCodec()
    lines = codec.feed(data).lines
    assert sum("Motor on" in line for line in lines) == 50
    assert codec.counters.checksum_failures > 5  # packets cut in two
    assert codec.counters.packets > 200


def test_packets_are_the_same_however_the_line_is_polled() -> None:
    def stream(seed: int) -> bytes:
        device = emulator()
        rng = np.random.default_rng(seed)
        orders = {
            1.0: b"SetRPM 240\n",
            3.0: b"MotorOff\n",
            5.0: b"MotorOn\n",
            7.0: b"ShowRaw\n",
        }
        polls = [*rng.uniform(0.0, 8.0, 100 * seed).tolist(), 8.0]
        sent = device.advance(0.0)
        for now_s in sorted([*polls, *orders]):
            if now_s in orders:
                device.receive(orders[now_s], now_s)
            if now_s in polls:
                sent += device.advance(now_s)
        return sent

    coarse, fine = stream(1), stream(20)
    assert len(coarse) > 20_000
    assert coarse == fine


def test_packets_come_at_the_rate_of_the_rotor_and_the_speed_of_the_line() -> None:
    device = emulator(rpm_ripple=0.0)
    run(device, 0.0, 5.0)
    assert len(run(device, 5.0, 65.0)) == pytest.approx(200 * 90 * 22, rel=0.002)
    widest = max(len(device.advance(65.0 + 0.001 * k)) for k in range(1, 1000))
    assert widest <= 12  # 115200 baud: 11.5 bytes a millisecond


def test_spin_up_takes_about_a_second_and_ripple_stays_within_its_figure() -> None:
    device = emulator(rpm_ripple=0.003)
    codec = LrfCodec()
    codec.feed(run(device, 0.0, 0.5))
    early = codec.feed(run(device, 0.5, 0.8)).rpm
    codec.feed(run(device, 0.8, 1.6))
    late = codec.feed(run(device, 1.6, 61.6)).rpm
    assert early[0] < 190.0
    assert late[0] == pytest.approx(200.0, rel=0.02)
    steady = late[1000:]
    assert steady.mean() == pytest.approx(200.0, rel=0.002)
    assert steady.std() == pytest.approx(0.6, rel=0.3)


def test_a_slow_rotor_sends_codes_in_half_turns_then_stops_with_a_banner() -> None:
    device = emulator()
    run(device, 0.0, 3.0)
    data = run(device, 3.0, 3.1)
    device.receive(b"MotorOff\n", 3.1)
    data += run(device, 3.1, 6.0)
    codec = LrfCodec()
    batch = codec.feed(data)
    rpm = batch.rpm
    slow = (rpm < 180.0) & (rpm >= 167.0)
    assert (batch.error_code[rpm < 167.0] == 0x52).all()
    assert (batch.strength[rpm < 167.0] == 968).all()
    assert (batch.error_code[slow] == 0x22).all()
    assert set(np.diff(batch.index[rpm < 160.0]) % 90) == {45, 46}
    assert not batch.is_invalid[rpm >= 180.0].all()
    assert batch.lines[:2] == ("Motor off", "OK")
    assert batch.lines[-1] == "Runtime\tV2.4.13386"
    at = data.index(b"OK\n\rPiccolo")
    assert data[at - 7] == 0xFA  # it broke off a packet
    assert len(batch) * 22 + 7 < at + 22


def test_at_rest_nothing_is_sent_and_nothing_is_looked_at() -> None:
    optics = StandingOptics()
    device = LrfEmulator(optics, np.random.default_rng(0))
    device.receive(b"MotorOff\n", 0.0)
    run(device, 0.0, 3.0)
    looks = len(optics.stamps_s)
    assert run(device, 3.0, 10.0) == b""
    assert len(optics.stamps_s) == looks


def test_hidden_raw_data_costs_no_look() -> None:
    optics = StandingOptics()
    device = LrfEmulator(optics, np.random.default_rng(0))
    device.receive(b"HideRaw\n", 0.0)
    assert run(device, 0.0, 5.0) == b""
    assert optics.stamps_s == []


def test_beams_are_looked_at_when_they_are_measured_and_never_ahead() -> None:
    optics = StandingOptics()
    device = LrfEmulator(optics, np.random.default_rng(0))
    for tick in range(1, 150):
        device.advance(tick * TICK_S)
        if optics.stamps_s:
            assert optics.stamps_s[-1][-1] <= tick * TICK_S
    stamps_s = np.concatenate(optics.stamps_s[-50:])
    assert np.median(np.diff(stamps_s)) == pytest.approx(60 / (200 * 360), rel=0.02)


def test_one_look_per_advance() -> None:
    optics = StandingOptics()
    device = LrfEmulator(optics, np.random.default_rng(0))
    run(device, 0.0, 3.0)
    looks = len(optics.stamps_s)
    device.advance(3.02)
    assert len(optics.stamps_s) == looks + 1
    assert len(optics.stamps_s[-1]) in (20, 24, 28)


def test_a_held_rotor_makes_the_controller_switch_off_after_two_seconds() -> None:
    device = emulator()
    run(device, 0.0, 3.0)
    device.block_rotor()
    assert b"Motor off" not in run(device, 3.0, 5.0)
    assert b" \r\nMotor off\r\n" in run(device, 5.0, 5.8)
    device.release_rotor()
    assert run(device, 5.8, 9.0) == b""  # stays off until MotorOn
    device.receive(b"MotorOn\n", 9.0)
    assert len(LrfCodec().feed(run(device, 9.0, 12.0))) > 500


def test_text_modes_print_lines_instead_of_packets() -> None:
    device = emulator()
    run(device, 0.0, 3.0)
    ask(device, b"ShowRPM\nShowInterval\nSetAngle 4, 9-11\nShowErrors\n", 3.0)
    text = run(device, 3.0, 4.0).decode("ascii")
    assert re.search(r"^A,4,\d+,400\r$", text, re.MULTILINE)
    assert re.search(r"^A,10,I\r$", text, re.MULTILINE)
    assert not re.search(r"^A,12,", text, re.MULTILINE)
    assert re.search(r"^R,(199|200),\d+\r$", text, re.MULTILINE)
    assert re.search(r"^T,(299|30[0-2])\r$", text, re.MULTILINE)
