# SPDX-License-Identifier: MIT
"""An MPU-6050 on its registers: reset, sleep, full-scale ranges, sample rate, big-endian data.

Written from InvenSense RM-MPU-6000A rev 4.2, not from the driver. Errors of the gyro (bias,
its random walk, scale, noise) come from [simulation]. Not modelled: FIFO, interrupts' pins,
self-test, the low-pass filter's lag of 5 ms.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from ins_robot.config import SimulationConfig
from ins_robot.simulation.emulators.body_motion import BodyMotion

SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG = 0x19, 0x1A, 0x1B, 0x1C
INT_STATUS, DATA, DATA_END = 0x3A, 0x3B, 0x48
SIGNAL_PATH_RESET, PWR_MGMT_1, WHO_AM_I = 0x68, 0x6B, 0x75
READ_ONLY = frozenset(range(INT_STATUS, 0x63)) | {WHO_AM_I}

DEVICE_RESET, SLEEP = 0x80, 0x40
DATA_READY = 0x01
UNFILTERED = (0, 7)  # DLPF settings with which the gyro runs at 8 kHz
GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)
ACCEL_LSB_PER_G = (16384.0, 8192.0, 4096.0, 2048.0)
LSB_MAX = 32767.0

_DATA = struct.Struct(">7h")  # accelerometer x y z, temperature, gyro x y z


class Mpu6050Emulator:
    """RegisterDevice: the gyro chip; `who_am_i` makes it one of the clones."""

    def __init__(
        self,
        motion: BodyMotion,
        config: SimulationConfig,
        rng: np.random.Generator,
        *,
        address: int = 0x68,
        who_am_i: int = 0x68,
        sign: float = 1.0,
    ) -> None:
        self.address = address
        self._who_am_i = who_am_i
        self._motion = motion
        self._rng = rng
        self._sign = sign
        self._noise_dps = config.gyro_noise_dps
        self._drift_dps = config.gyro_drift_dps
        self._scale = 1.0 + config.gyro_scale_std * float(rng.standard_normal())
        self.bias_dps: list[float] = (config.gyro_bias_dps * rng.standard_normal(3)).tolist()
        self._registers = bytearray(128)
        self._sampled_at_s = -math.inf
        self.power_on()

    def power_on(self) -> None:
        """Reset values; asleep, as after every power-up."""
        self._registers[:] = bytes(len(self._registers))
        self._registers[PWR_MGMT_1] = SLEEP
        self._registers[WHO_AM_I] = self._who_am_i

    def read(self, register: int, length: int, now_s: float) -> bytes:
        """Burst read; one burst sees one sample."""
        last = register + length
        if register <= DATA_END and last > INT_STATUS:
            self._sample(now_s)
        data = bytes(self._registers[r & 0x7F] for r in range(register, last))
        if register <= INT_STATUS < last:
            self._registers[INT_STATUS] = 0
        return data

    def write(self, register: int, data: bytes, now_s: float) -> None:
        """Burst write; the device reset clears itself at once."""
        for r, value in enumerate(data, start=register):
            if r == PWR_MGMT_1 and value & DEVICE_RESET:
                self.power_on()
            elif r == SIGNAL_PATH_RESET:
                self._registers[DATA : DATA_END + 1] = bytes(DATA_END + 1 - DATA)
            elif r not in READ_ONLY and r < len(self._registers):
                self._registers[r] = value
                if r == PWR_MGMT_1:
                    self._sampled_at_s = -math.inf  # a chip just woken measures at once

    def _sample(self, now_s: float) -> None:
        registers = self._registers
        if registers[PWR_MGMT_1] & SLEEP:
            registers[DATA : DATA_END + 1] = bytes(DATA_END + 1 - DATA)
            return
        clock_hz = 8000.0 if registers[CONFIG] & 0x07 in UNFILTERED else 1000.0
        if now_s - self._sampled_at_s < (1 + registers[SMPLRT_DIV]) / clock_hz:
            return
        draws = self._rng.standard_normal(9).tolist()
        if math.isfinite(self._sampled_at_s):
            walk = self._drift_dps * math.sqrt(now_s - self._sampled_at_s)
            self.bias_dps = [
                b + walk * d for b, d in zip(self.bias_dps, draws[6:], strict=True)
            ]
        self._sampled_at_s = now_s
        rate_dps = self._sign * math.degrees(self._motion.yaw_rate_radps(now_s)) * self._scale
        per_dps = GYRO_LSB_PER_DPS[registers[GYRO_CONFIG] >> 3 & 0x03]
        per_g = ACCEL_LSB_PER_G[registers[ACCEL_CONFIG] >> 3 & 0x03]
        bx, by, bz = self.bias_dps
        bz += self._motion.gyro_shift_dps(now_s)
        noise = self._noise_dps
        _DATA.pack_into(
            registers,
            DATA,
            _lsb(0.003 * draws[3] * per_g),
            _lsb(0.003 * draws[4] * per_g),
            _lsb((self._sign + 0.003 * draws[5]) * per_g),
            _lsb((self._motion.temperature_c - 36.53) * 340.0),
            _lsb((bx + noise * draws[0]) * per_dps),
            _lsb((by + noise * draws[1]) * per_dps),
            _lsb((rate_dps + bz + noise * draws[2]) * per_dps),
        )
        registers[INT_STATUS] |= DATA_READY


def _lsb(value: float) -> int:
    """Round to the converter's range; beyond it the chip saturates."""
    return round(min(LSB_MAX, max(-LSB_MAX - 1.0, value)))
