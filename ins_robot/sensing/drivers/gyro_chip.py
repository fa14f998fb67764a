# SPDX-License-Identifier: MIT
"""The MPU-6050 family, register by register: identity, configuration, one reading.

Blocking calls for the thread that owns the bus; when to wait and what to retry is
`drivers.imu`'s business. Source: InvenSense RM-MPU-6000A rev 4.2 and PS-MPU-6000A rev 3.4.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from ins_robot.errors import DeviceError
from ins_robot.sensing.ports import I2cBus

SMPLRT_DIV, CONFIG, GYRO_CONFIG = 0x19, 0x1A, 0x1B
TEMP_AND_GYRO = 0x41  # temperature, then gyro x, y, z: big-endian, one coherent burst
SIGNAL_PATH_RESET, PWR_MGMT_1, WHO_AM_I = 0x68, 0x6B, 0x75

RESET = 0x80
AWAKE_ON_GYRO_CLOCK = 0x01  # steadier than the internal oscillator
CONFIGURATION = (
    (PWR_MGMT_1, AWAKE_ON_GYRO_CLOCK),
    (SMPLRT_DIV, 4),  # 1 kHz / 5: a reading is never older than 5 ms
    (CONFIG, 3),  # low pass 42 Hz, delay 4.8 ms
    (GYRO_CONFIG, 0x00),  # 250 deg/s
)
RADPS_PER_LSB = math.radians(1.0 / 131.0)
SATURATED_LSB = 32_760

RESET_TIME_S = 0.1  # datasheet: 100 ms after reset, 100 ms after the signal path reset
WAKE_TIME_S = 0.05  # gyro start-up 30 ms

_READING = struct.Struct(">4h")
_NOTHING = b"\0" * _READING.size


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What a WHO_AM_I value stands for, with its thermometer (degC = lsb / slope + offset)."""

    name: str
    celsius_slope: float = 340.0
    celsius_offset: float = 36.53


IDENTITIES = {
    0x68: Identity(name="MPU-6050"),
    0x70: Identity(name="MPU-6500", celsius_slope=333.87, celsius_offset=21.0),
    0x71: Identity(name="MPU-9250", celsius_slope=333.87, celsius_offset=21.0),
    0x73: Identity(name="MPU-9255", celsius_slope=333.87, celsius_offset=21.0),
    0x74: Identity(name="MPU clone 0x74", celsius_slope=333.87, celsius_offset=21.0),
    0x75: Identity(name="MPU clone 0x75", celsius_slope=333.87, celsius_offset=21.0),
    0x78: Identity(name="MPU clone 0x78", celsius_slope=333.87, celsius_offset=21.0),
    0x98: Identity(name="ICM-20689", celsius_slope=326.8, celsius_offset=25.0),
}
GENUINE = 0x68


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroReading:
    """Rate about the chip's z axis, and its temperature."""

    yaw_rate_radps: float
    temperature_c: float
    is_saturated: bool


class GyroChip:
    """One chip at one address."""

    def __init__(self, bus: I2cBus, address: int, bus_name: str) -> None:
        self._bus = bus
        self._address = address
        self._where = f"gyro at 0x{address:02x} on {bus_name}"
        self.identity = IDENTITIES[GENUINE]
        self.is_clone = False

    def identify(self) -> None:
        """Check WHO_AM_I.

        Raises
        ------
        DeviceError
            Something else answers: got, expected and likely cause.
        """
        who = self._bus.read(self._address, WHO_AM_I, 1)[0]
        if who not in IDENTITIES:
            cause = {
                0x00: "the data line is held low, or the chip is without power",
                0xFF: "nothing drives the data line: wiring or pull-ups",
            }.get(who, "another chip at this address, such as a DS3231 clock")
            raise DeviceError(
                f"{self._where}: WHO_AM_I is 0x{who:02x}, expected 0x68 or one of its clones "
                f"({', '.join(f'0x{k:02x}' for k in IDENTITIES if k != GENUINE)}); "
                f"likely {cause}; check the wiring and imu.gyro_address"
            )
        self.identity = IDENTITIES[who]
        self.is_clone = who != GENUINE

    def reset(self) -> None:
        """All registers to their reset values; wait RESET_TIME_S."""
        self._write(PWR_MGMT_1, RESET)

    def reset_signal_path(self) -> None:
        """Clear the filters of gyro, accelerometer and thermometer; wait RESET_TIME_S."""
        self._write(SIGNAL_PATH_RESET, 0x07)

    def configure(self) -> None:
        """Wake up and set rate, filter and range; wait WAKE_TIME_S before the first reading."""
        for register, value in CONFIGURATION:
            self._write(register, value)

    def difference(self) -> str:
        """What the registers hold other than `configure` wrote; "" when all is as written."""
        for register, wanted in CONFIGURATION:
            got = self._bus.read(self._address, register, 1)[0]
            if got != wanted:
                return (
                    f"{self._where}: register 0x{register:02x} reads 0x{got:02x} after "
                    f"0x{wanted:02x} was written"
                )
        return ""

    def read(self) -> GyroReading | None:
        """One reading; None when all is zero, as from a chip that fell asleep."""
        raw = self._bus.read(self._address, TEMP_AND_GYRO, _READING.size)
        if raw == _NOTHING:
            return None
        temperature, _x, _y, z = _READING.unpack(raw)
        return GyroReading(
            yaw_rate_radps=z * RADPS_PER_LSB,
            temperature_c=(
                temperature / self.identity.celsius_slope + self.identity.celsius_offset
            ),
            is_saturated=abs(z) >= SATURATED_LSB,
        )

    def _write(self, register: int, value: int) -> None:
        self._bus.write(self._address, register, bytes([value]))
