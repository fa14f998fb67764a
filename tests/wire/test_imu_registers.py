# SPDX-License-Identifier: MIT
"""The emulated chips against their datasheets, register by register, without our driver."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from imu_bench import EXACT, Turntable, gyro, hmc, qmc

from ins_robot.config import ImuConfig, SimulationConfig
from ins_robot.simulation.emulators.imu import Mpu6050Emulator, build_imu_devices

PWR = 0x6B


def z_lsb(chip: Mpu6050Emulator, now_s: float) -> int:
    return int(struct.unpack(">h", chip.read(0x47, 2, now_s))[0])


def awake(table: Turntable, config: SimulationConfig = EXACT) -> Mpu6050Emulator:
    chip = gyro(table, config)
    chip.write(PWR, b"\x01", 0.0)
    return chip


def test_gyro_wakes_up_asleep_and_reads_zero() -> None:
    chip = gyro(Turntable(rate_radps=1.0))
    assert chip.read(PWR, 1, 0.0) == b"\x40"
    assert chip.read(0x75, 1, 0.0) == b"\x68"
    assert chip.read(0x3B, 14, 0.0) == bytes(14)
    chip.write(PWR, b"\x01", 0.0)
    assert z_lsb(chip, 0.1) == round(math.degrees(1.0) * 131.0)
    chip.write(PWR, b"\x41", 0.2)
    assert chip.read(0x3B, 14, 0.3) == bytes(14)


@pytest.mark.parametrize(("bits", "per_dps"), [(0, 131.0), (1, 65.5), (2, 32.8), (3, 16.4)])
def test_gyro_ranges_and_saturation(bits: int, per_dps: float) -> None:
    table = Turntable(rate_radps=-2.0)
    chip = awake(table)
    chip.write(0x1B, bytes([bits << 3]), 0.0)
    assert z_lsb(chip, 0.1) == round(math.degrees(-2.0) * per_dps)
    table.rate_radps = 100.0
    assert z_lsb(chip, 0.2) == 32767
    table.rate_radps = -100.0
    assert z_lsb(chip, 0.3) == -32768


def test_gyro_burst_has_gravity_and_temperature() -> None:
    chip = awake(Turntable(temperature_c=36.53))
    x, y, z, t, *_gyro = struct.unpack(">7h", chip.read(0x3B, 14, 0.1))
    assert abs(x) < 300
    assert abs(y) < 300
    assert z == pytest.approx(16384, abs=300)
    assert t == 0
    chip.write(0x1C, b"\x18", 0.1)
    assert struct.unpack(">h", chip.read(0x3F, 2, 0.2))[0] == pytest.approx(2048, abs=40)


def test_gyro_holds_a_sample_for_its_period() -> None:
    """DLPF 3 and divider 9: 100 Hz; INT_STATUS tells, and reading it clears it."""
    chip = awake(Turntable(), SimulationConfig())
    chip.write(0x19, b"\x09", 0.0)
    chip.write(0x1A, b"\x03", 0.0)
    first = chip.read(0x43, 6, 1.0)
    assert chip.read(0x43, 6, 1.009) == first
    assert chip.read(0x43, 6, 1.0101) != first
    assert chip.read(0x3A, 1, 1.0102) == b"\x01"
    assert chip.read(0x3A, 1, 1.0103) == b"\x00"
    assert chip.read(0x3A, 1, 1.0300) == b"\x01"


def test_gyro_read_only_registers() -> None:
    chip = awake(Turntable())
    chip.write(0x75, b"\x00", 0.0)
    chip.write(0x47, b"\x12\x34", 0.0)
    assert chip.read(0x75, 1, 0.0) == b"\x68"
    assert z_lsb(chip, 0.1) == 0


def test_gyro_survives_the_adafruit_driver() -> None:
    """Its init sequence, transaction by transaction (HARDWARE facts, section 5)."""
    chip = gyro(Turntable(rate_radps=0.5))
    assert chip.read(0x75, 1, 0.0)[0] == 0x68
    value = chip.read(PWR, 1, 0.0)[0] | 0x80  # read, modify, write of one bit
    assert value == 0xC0
    chip.write(PWR, bytes([value]), 0.0)
    assert not chip.read(PWR, 1, 0.001)[0] & 0x80  # it waits until the bit clears itself
    assert chip.read(PWR, 1, 0.001)[0] == 0x40
    chip.write(0x68, b"\x38", 0.1)
    chip.write(0x1A, b"\x00", 0.2)
    chip.write(0x1B, b"\x08", 0.2)  # 500 deg/s
    chip.write(0x1C, b"\x00", 0.2)
    chip.write(PWR, b"\x41", 0.3)
    chip.write(PWR, b"\x01", 0.4)
    _x, _y, z = struct.unpack(">3h", chip.read(0x43, 6, 0.5))
    assert math.radians(z / 65.5) == pytest.approx(0.5, abs=2e-4)


def test_gyro_errors_are_those_of_the_config() -> None:
    config = SimulationConfig(gyro_noise_dps=0.05, gyro_drift_dps=0.0, gyro_bias_dps=1.0)
    chip = awake(Turntable(), config)
    dps = np.array([z_lsb(chip, 0.01 * k) for k in range(2000)]) / 131.0
    assert dps.mean() == pytest.approx(chip.bias_dps[2], abs=0.01)
    assert dps.std() == pytest.approx(0.05, rel=0.1)
    walks = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        chip = Mpu6050Emulator(Turntable(), SimulationConfig(gyro_drift_dps=0.01), rng)
        chip.write(PWR, b"\x01", 0.0)
        z_lsb(chip, 1.0)
        begin = chip.bias_dps[2]
        z_lsb(chip, 101.0)
        walks.append(chip.bias_dps[2] - begin)
    assert np.std(walks) == pytest.approx(0.01 * math.sqrt(100.0), rel=0.35)


def test_same_seed_same_bytes() -> None:
    def run() -> bytes:
        devices = build_imu_devices(
            Turntable(), ImuConfig(), SimulationConfig(), np.random.default_rng(7)
        )
        chip, compass = devices
        chip.write(PWR, b"\x01", 0.0)
        compass.write(2, b"\x00", 0.0)
        return b"".join(
            chip.read(0x41, 8, 0.02 * k) + compass.read(3, 6, 0.02 * k) for k in range(200)
        )

    assert run() == run()


# HMC5883L


def hmc_axes(chip: object, now_s: float) -> tuple[int, int, int]:
    x, z, y = struct.unpack(">3h", chip.read(3, 6, now_s))  # type: ignore[attr-defined]
    return x, y, z


def test_hmc_identity_and_power_on_values() -> None:
    chip = hmc(Turntable())
    assert chip.read(10, 3, 0.0) == b"H43"
    assert chip.read(0, 3, 0.0) == bytes([0x10, 0x20, 0x01])
    chip.write(10, b"XXX", 0.0)
    assert chip.read(10, 3, 0.0) == b"H43"


def test_hmc_measures_continuously_at_its_rate() -> None:
    table = Turntable(field=(0.2, 0.1, -0.4))
    chip = hmc(table)
    chip.write(2, b"\x00", 0.0)
    assert chip.read(9, 1, 0.05)[0] & 1 == 0  # 15 Hz: not yet
    assert chip.read(9, 1, 0.07)[0] & 1 == 1
    assert hmc_axes(chip, 0.07) == (218, 109, -436)
    table.field = (0.0, 0.0, 0.0)
    assert hmc_axes(chip, 0.10) == (218, 109, -436)
    assert hmc_axes(chip, 0.14) == (0, 0, 0)


def test_hmc_first_sample_after_a_gain_change_has_the_old_gain() -> None:
    chip = hmc(Turntable(field=(0.5, 0.0, 0.0)))
    chip.write(2, b"\x00", 0.0)
    assert hmc_axes(chip, 0.1)[0] == 545
    chip.write(1, b"\x80", 0.1)
    assert hmc_axes(chip, 0.2)[0] == 545
    assert hmc_axes(chip, 0.3)[0] == 220


def test_hmc_overflow_is_minus_4096() -> None:
    chip = hmc(Turntable(field=(3.0, 0.1, -3.0)))
    chip.write(2, b"\x00", 0.0)
    assert hmc_axes(chip, 0.1) == (-4096, 109, -4096)


def test_hmc_half_read_data_are_locked() -> None:
    table = Turntable(field=(0.1, 0.1, 0.1))
    chip = hmc(table)
    chip.write(2, b"\x00", 0.0)
    first = chip.read(3, 1, 0.1)
    assert chip.read(9, 1, 0.1)[0] & 2
    table.field = (0.9, 0.9, 0.9)
    rest = chip.read(4, 5, 0.5)
    assert struct.unpack(">3h", first + rest) == (109, 109, 109)
    assert hmc_axes(chip, 0.6) == (981, 981, 981)


def test_hmc_single_measurement_then_idle() -> None:
    chip = hmc(Turntable())
    chip.write(2, b"\x01", 0.0)
    assert chip.read(9, 1, 0.003)[0] & 1 == 0
    assert chip.read(9, 1, 0.007)[0] & 1 == 1
    assert chip.read(2, 1, 0.007)[0] & 2


def test_hmc_self_test_field() -> None:
    """Datasheet: CRA 0x71, gain 5: X and Y near +452, Z near +421 above the field."""
    chip = hmc(Turntable(field=(0.0, 0.0, 0.0)))
    chip.write(0, bytes([0x71, 0xA0, 0x00]), 0.0)
    hmc_axes(chip, 0.1)
    assert hmc_axes(chip, 0.2) == (452, 452, 421)


# QMC5883L


def test_qmc_identity_reset_and_data_ready() -> None:
    table = Turntable(field=(0.2, 0.1, -0.4))
    chip = qmc(table)
    assert chip.read(0x0D, 1, 0.0) == b"\xff"
    assert chip.read(6, 1, 0.5) == b"\x00"  # standby
    chip.write(0x0B, b"\x01", 0.5)
    chip.write(0x09, b"\x11", 0.5)  # 8 G, 10 Hz, continuous
    assert chip.read(6, 1, 0.55)[0] & 1 == 0
    assert chip.read(6, 1, 0.61)[0] & 1 == 1
    assert struct.unpack("<3h", chip.read(0, 6, 0.61)) == (600, 300, -1200)
    assert chip.read(6, 1, 0.62)[0] & 1 == 0  # reading the data clears it
    chip.write(0x0A, b"\x80", 0.7)
    assert chip.read(9, 1, 0.7) == b"\x00"


def test_qmc_range_overflow_and_skipped_data() -> None:
    table = Turntable(field=(0.5, 0.0, 0.0))
    chip = qmc(table)
    chip.write(0x09, b"\x01", 0.0)  # 2 G
    assert struct.unpack("<h", chip.read(0, 2, 0.2))[0] == 6000
    table.field = (5.0, 0.0, 0.0)
    assert chip.read(6, 1, 0.35)[0] & 0x07 == 0x03
    assert chip.read(6, 1, 0.65)[0] & 0x04  # nobody read the last


def test_compass_is_mounted_as_configured() -> None:
    """A chip whose x axis points left (90 deg) sees the field ahead on its -y axis."""
    chip = qmc(Turntable(field=(0.4, 0.0, 0.0)), yaw=math.pi / 2)
    chip.write(0x09, b"\x11", 0.0)
    x, y, _z = struct.unpack("<3h", chip.read(0, 6, 0.2))
    assert (x, y) == (0, -1200)
