# SPDX-License-Identifier: MIT
"""A body that turns as told, and a bus with emulated chips on it that can be made to fail."""

from __future__ import annotations

import errno
from dataclasses import dataclass

import numpy as np

from ins_robot.config import SimulationConfig
from ins_robot.simulation.emulators.imu import (
    Hmc5883lEmulator,
    Mpu6050Emulator,
    Qmc5883lEmulator,
)

EXACT = SimulationConfig(
    gyro_noise_dps=0.0, gyro_bias_dps=0.0, gyro_drift_dps=0.0, gyro_scale_std=0.0,
    compass_noise_deg=0.0,
)  # fmt: skip


@dataclass
class Turntable:
    """BodyMotion at will."""

    rate_radps: float = 0.0
    field: tuple[float, float, float] = (0.2, 0.1, -0.4)
    temperature_c: float = 30.0

    def yaw_rate_radps(self, now_s: float) -> float:
        return self.rate_radps

    def gyro_shift_dps(self, now_s: float) -> float:
        return 0.0

    def field_gauss(self, now_s: float) -> tuple[float, float, float]:
        return self.field


def gyro(table: Turntable, config: SimulationConfig = EXACT, **options: int) -> Mpu6050Emulator:
    return Mpu6050Emulator(table, config, np.random.default_rng(1), **options)


def hmc(
    table: Turntable, config: SimulationConfig = EXACT, yaw: float = 0.0
) -> Hmc5883lEmulator:
    return Hmc5883lEmulator(table, config, np.random.default_rng(2), yaw_rad=yaw)


def qmc(
    table: Turntable, config: SimulationConfig = EXACT, yaw: float = 0.0
) -> Qmc5883lEmulator:
    return Qmc5883lEmulator(table, config, np.random.default_rng(3), yaw_rad=yaw)


class FaultyBus:
    """I2cBus over emulators; `failures` transfers to come, or all to `dead` addresses, fail."""

    def __init__(self, devices: list[object], clock: object) -> None:
        self._devices = {device.address: device for device in devices}  # type: ignore[attr-defined]
        self._clock = clock
        self.failures = 0
        self.dead: set[int] = set()
        self.is_closed = False
        self.transfers: list[tuple[str, int, int]] = []

    def read(self, address: int, register: int, length: int) -> bytes:
        self.transfers.append(("read", address, register))
        return self._device(address).read(register, length, self._clock())

    def write(self, address: int, register: int, data: bytes) -> None:
        self.transfers.append(("write", address, register))
        self._device(address).write(register, data, self._clock())

    def close(self) -> None:
        self.is_closed = True

    def _device(self, address: int):  # type: ignore[no-untyped-def]
        if self.failures > 0:
            self.failures -= 1
            raise OSError(errno.EIO, "Input/output error")
        if address in self.dead or address not in self._devices:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return self._devices[address]
