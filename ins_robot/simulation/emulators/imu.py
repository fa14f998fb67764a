# SPDX-License-Identifier: MIT
"""The I2C devices of the simulated robot, mounted as a config says."""

from __future__ import annotations

import math

import numpy as np

from ins_robot.config import ImuConfig, SimulationConfig
from ins_robot.simulation.emulators.body_motion import BodyMotion
from ins_robot.simulation.emulators.compass_chip import Hmc5883lEmulator, Qmc5883lEmulator
from ins_robot.simulation.emulators.gyro_chip import Mpu6050Emulator
from ins_robot.simulation.wire_device import RegisterDevice

__all__ = [
    "BodyMotion",
    "Hmc5883lEmulator",
    "Mpu6050Emulator",
    "Qmc5883lEmulator",
    "build_imu_devices",
]


def build_imu_devices(
    motion: BodyMotion,
    imu: ImuConfig,
    simulation: SimulationConfig,
    rng: np.random.Generator,
) -> list[RegisterDevice]:
    """The gyro and the compass that `simulation.compass_chip` names, one seed for each."""
    gyro_rng, compass_rng = rng.spawn(2)
    gyro = Mpu6050Emulator(
        motion, simulation, gyro_rng, address=imu.gyro_address, sign=imu.gyro_sign
    )
    yaw_rad = math.radians(imu.compass_yaw_deg)
    compass: RegisterDevice
    if simulation.compass_chip == "hmc5883l":
        compass = Hmc5883lEmulator(motion, simulation, compass_rng, yaw_rad=yaw_rad)
    else:
        compass = Qmc5883lEmulator(motion, simulation, compass_rng, yaw_rad=yaw_rad)
    return [gyro, compass]
