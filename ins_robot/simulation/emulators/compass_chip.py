# SPDX-License-Identifier: MIT
"""HMC5883L and QMC5883L on their registers: modes, gain, overflow, data ready, lock.

Written from the Honeywell (2010) and QST datasheets, not from the driver. `yaw_rad` is how the
chip sits on the body. Measurements are taken lazily: at the first access after they were due.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from ins_robot.config import SimulationConfig
from ins_robot.simulation.emulators.body_motion import BodyMotion


class _Sensor:
    """The field in the chip's axes, with noise."""

    def __init__(
        self,
        motion: BodyMotion,
        config: SimulationConfig,
        rng: np.random.Generator,
        yaw_rad: float,
    ) -> None:
        self._motion = motion
        self._rng = rng
        self._noise_rad = math.radians(config.compass_noise_deg)
        self._cos, self._sin = math.cos(yaw_rad), math.sin(yaw_rad)

    def field_gauss(self, now_s: float) -> tuple[float, float, float]:
        x, y, z = self._motion.field_gauss(now_s)
        # Noise across the horizontal field is noise of the heading read from it.
        noise = (self._noise_rad * math.hypot(x, y) * self._rng.standard_normal(3)).tolist()
        return (
            self._cos * x + self._sin * y + noise[0],
            self._cos * y - self._sin * x + noise[1],
            z + noise[2],
        )


class Hmc5883lEmulator:
    """RegisterDevice at 0x1E."""

    CRA, CRB, MODE, DATA, DATA_END, STATUS, LAST = 0, 1, 2, 3, 8, 9, 12
    RATES_HZ = (0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0, 75.0)
    LSB_PER_GAUSS = (1370.0, 1090.0, 820.0, 660.0, 440.0, 390.0, 330.0, 230.0)
    SELF_TEST_GAUSS = (1.16, 1.16, 1.08)
    CONTINUOUS, SINGLE, IDLE = 0, 1, 3
    SINGLE_TIME_S = 0.006
    NOT_READY_S = 250e-6  # RDY is low for this long around a write to the data registers
    OVERFLOW = -4096
    LSB_LIMITS = -2048.5, 2047.5  # between them a reading rounds to its twelve bits

    def __init__(
        self,
        motion: BodyMotion,
        config: SimulationConfig,
        rng: np.random.Generator,
        *,
        yaw_rad: float = 0.0,
    ) -> None:
        self.address = 0x1E
        self._sensor = _Sensor(motion, config, rng, yaw_rad)
        self.power_on()

    def power_on(self) -> None:
        """Reset values: one measurement, then idle."""
        self._registers = bytearray(13)
        self._registers[self.CRA : self.MODE + 1] = (0x10, 0x20, self.SINGLE)
        self._registers[10:13] = b"H43"
        self._gain = 1
        self._unread: set[int] = set()
        self._is_locked = False
        self._due_s: float | None = None
        self._measured_at_s: float | None = None

    def read(self, register: int, length: int, now_s: float) -> bytes:
        """Burst read; the pointer returns from the last data register to the first."""
        self._measure_if_due(now_s)
        data = bytearray()
        for _ in range(length):
            data.append(self._registers[register])
            if self.DATA <= register <= self.DATA_END:
                self._unread.discard(register)
                self._is_locked = bool(self._unread)
            if register == self.DATA_END:
                register = self.DATA
            else:
                register = 0 if register >= self.LAST else register + 1
        return bytes(data)

    def write(self, register: int, data: bytes, now_s: float) -> None:
        """Burst write to the three configuration registers; the others cannot be written."""
        self._measure_if_due(now_s)
        for r, value in enumerate(data, start=register):
            if r > self.MODE:
                break
            self._registers[r] = value
            if r == self.MODE:
                self._is_locked = False
                single = value & 0x03 == self.SINGLE
                is_running = single or value & 0x03 == self.CONTINUOUS
                wait_s = self.SINGLE_TIME_S if single else self._period_s()
                self._due_s = now_s + wait_s if is_running else None

    def _period_s(self) -> float:
        return 1.0 / self.RATES_HZ[self._registers[self.CRA] >> 2 & 0x07]

    def _measure_if_due(self, now_s: float) -> None:
        if self._due_s is not None and now_s >= self._due_s:
            if self._registers[self.MODE] & 0x03 == self.SINGLE:
                measured_at_s, self._due_s = self._due_s, None
                self._registers[self.MODE] = self.IDLE
            else:
                period_s = self._period_s()
                measured_at_s = self._due_s + (now_s - self._due_s) // period_s * period_s
                self._due_s = measured_at_s + period_s
            if not self._is_locked:  # data half read are kept whole
                self._measure(now_s)
                self._measured_at_s = measured_at_s
        is_ready = self._measured_at_s is not None and (
            now_s - self._measured_at_s >= self.NOT_READY_S
        )
        self._registers[self.STATUS] = is_ready | self._is_locked << 1

    def _measure(self, now_s: float) -> None:
        x, y, z = self._sensor.field_gauss(now_s)
        test = {1: 1.0, 2: -1.0}.get(self._registers[self.CRA] & 0x03, 0.0)
        tx, ty, tz = self.SELF_TEST_GAUSS
        scale = self.LSB_PER_GAUSS[self._gain]
        self._gain = self._registers[self.CRB] >> 5  # a new gain holds from the next one on
        struct.pack_into(
            ">3h",
            self._registers,
            self.DATA,
            self._lsb((x + test * tx) * scale),
            self._lsb((z + test * tz) * scale),
            self._lsb((y + test * ty) * scale),
        )
        self._unread = set(range(self.DATA, self.DATA_END + 1))

    def _lsb(self, value: float) -> int:
        low, high = self.LSB_LIMITS
        return round(value) if low < value < high else self.OVERFLOW


class Qmc5883lEmulator:
    """RegisterDevice at 0x0D."""

    DATA_END, STATUS, TEMPERATURE, CONTROL_1, CONTROL_2, PERIOD, CHIP_ID = (
        5,
        6,
        7,
        9,
        10,
        11,
        13,
    )
    DATA_READY, OVERFLOWN, SKIPPED = 0x01, 0x02, 0x04
    RATES_HZ = (10.0, 50.0, 100.0, 200.0)
    LSB_PER_GAUSS = (12000.0, 3000.0, 3000.0, 3000.0)
    CONTINUOUS = 1
    SOFT_RESET, POINTER_ROLLS = 0x80, 0x40
    LSB_MAX = 32767.0

    def __init__(
        self,
        motion: BodyMotion,
        config: SimulationConfig,
        rng: np.random.Generator,
        *,
        yaw_rad: float = 0.0,
    ) -> None:
        self.address = 0x0D
        self._sensor = _Sensor(motion, config, rng, yaw_rad)
        self._motion = motion
        self.power_on()

    def power_on(self) -> None:
        """Reset values: standby."""
        self._registers = bytearray(14)
        self._registers[self.CHIP_ID] = 0xFF
        self._due_s: float | None = None

    def read(self, register: int, length: int, now_s: float) -> bytes:
        """Burst read; touching the data clears data ready."""
        self._measure_if_due(now_s)
        data = bytearray()
        for _ in range(length):
            data.append(self._registers[register])
            if register <= self.DATA_END:
                self._registers[self.STATUS] &= ~(self.DATA_READY | self.SKIPPED)
            rolls = self._registers[self.CONTROL_2] & self.POINTER_ROLLS
            if register == self.STATUS and rolls:
                register = 0
            else:
                register = 0 if register >= self.CHIP_ID else register + 1
        return bytes(data)

    def write(self, register: int, data: bytes, now_s: float) -> None:
        """Burst write to the control registers; the others cannot be written."""
        self._measure_if_due(now_s)
        for r, value in enumerate(data, start=register):
            if r == self.CONTROL_2 and value & self.SOFT_RESET:
                self.power_on()
            elif self.CONTROL_1 <= r <= self.PERIOD:
                self._registers[r] = value
                if r == self.CONTROL_1:
                    is_running = value & 0x03 == self.CONTINUOUS
                    self._due_s = now_s + self._period_s() if is_running else None

    def _period_s(self) -> float:
        return 1.0 / self.RATES_HZ[self._registers[self.CONTROL_1] >> 2 & 0x03]

    def _measure_if_due(self, now_s: float) -> None:
        if self._due_s is None or now_s < self._due_s:
            return
        period_s = self._period_s()
        skipped = (now_s - self._due_s) // period_s
        self._due_s += (1.0 + skipped) * period_s
        scale = self.LSB_PER_GAUSS[self._registers[self.CONTROL_1] >> 4 & 0x03]
        raw = [scale * axis for axis in self._sensor.field_gauss(now_s)]
        was_unread = self._registers[self.STATUS] & self.DATA_READY
        status = self.DATA_READY | (self.SKIPPED if skipped or was_unread else 0)
        if max(map(abs, raw)) > self.LSB_MAX:
            status |= self.OVERFLOWN
        lsb = [round(min(self.LSB_MAX, max(-self.LSB_MAX - 1.0, value))) for value in raw]
        struct.pack_into("<3h", self._registers, 0, *lsb)
        temperature = round(100.0 * (self._motion.temperature_c - 25.0))
        struct.pack_into("<h", self._registers, self.TEMPERATURE, temperature)
        self._registers[self.STATUS] = status
