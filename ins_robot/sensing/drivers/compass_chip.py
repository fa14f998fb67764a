# SPDX-License-Identifier: MIT
"""HMC5883L and QMC5883L, register by register; `probe_compass` tells which one is there.

Blocking calls for the thread that owns the bus. `read` gives the field in the chip's axes, in
gauss, or None where there is no new or no usable reading. Sources: Honeywell HMC5883L datasheet
(2010), pages 11-19; QST QMC5883L datasheet rev 1.0.
"""

from __future__ import annotations

import struct
from typing import Protocol

from ins_robot.sensing.ports import I2cBus

Field = tuple[float, float, float]

HMC_ADDRESS, QMC_ADDRESS = 0x1E, 0x0D
RANGE_UP_AFTER = 5  # overflows in a row


class CompassChip(Protocol):
    """A magnetometer."""

    name: str
    overflows: int

    def configure(self) -> bool:
        """Start continuous measurement; False when the chip did not take it."""
        ...

    def read(self) -> Field | None:
        """The field when there is a new, usable reading."""
        ...


def probe_compass(bus: I2cBus) -> CompassChip | None:
    """Look for the compasses known here; None when none answers and takes its settings.

    An absent device answers with OSError; that is the one case where it is no failure.
    """
    chips: tuple[CompassChip, ...] = (Hmc5883l(bus), Qmc5883l(bus))
    for chip in chips:
        try:
            if chip.configure():
                return chip
        except OSError:
            continue
    return None


class Hmc5883l:
    """Honeywell HMC5883L: big-endian, axes in the order x, z, y."""

    CRA, CRB, MODE, DATA, STATUS, ID = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A
    AVERAGE_8_AT_15_HZ = 0x70
    CONTINUOUS = 0x00
    LSB_PER_GAUSS = (1370.0, 1090.0, 820.0, 660.0, 440.0, 390.0, 330.0, 230.0)
    START_GAIN = 1  # +-1.3 gauss: the earth's 0.25 to 0.65 and what a motor adds
    OVERFLOW = -4096

    def __init__(self, bus: I2cBus) -> None:
        self._bus = bus
        self.name = "HMC5883L"
        self.overflows = 0
        self._gain = self.START_GAIN
        self._overflows_in_row = 0
        self._discard = 0

    def configure(self) -> bool:
        """Check 'H43', then 8 averages at 15 Hz, continuous; read back."""
        if self._bus.read(HMC_ADDRESS, self.ID, 3) != b"H43":
            return False
        self._write(self.CRA, self.AVERAGE_8_AT_15_HZ)
        self._set_gain(self._gain)
        self._write(self.MODE, self.CONTINUOUS)
        wanted = bytes([self.AVERAGE_8_AT_15_HZ, self._gain << 5, self.CONTINUOUS])
        return self._bus.read(HMC_ADDRESS, self.CRA, 3) == wanted

    def read(self) -> Field | None:
        """A new reading; an overflow is none, and five in a row widen the range."""
        if not self._bus.read(HMC_ADDRESS, self.STATUS, 1)[0] & 0x01:
            return None
        x, z, y = struct.unpack(">3h", self._bus.read(HMC_ADDRESS, self.DATA, 6))
        if self._discard:
            self._discard -= 1
            return None
        if self.OVERFLOW in (x, y, z):
            self._on_overflow()
            return None
        self._overflows_in_row = 0
        lsb_per_gauss = self.LSB_PER_GAUSS[self._gain]
        return x / lsb_per_gauss, y / lsb_per_gauss, z / lsb_per_gauss

    def _on_overflow(self) -> None:
        self.overflows += 1
        self._overflows_in_row += 1
        is_widest = self._gain == len(self.LSB_PER_GAUSS) - 1
        if self._overflows_in_row >= RANGE_UP_AFTER and not is_widest:
            self._overflows_in_row = 0
            self._set_gain(self._gain + 1)

    def _set_gain(self, gain: int) -> None:
        self._write(self.CRB, gain << 5)
        self._gain = gain
        self._discard = 1  # datasheet: the first sample still has the old gain

    def _write(self, register: int, value: int) -> None:
        self._bus.write(HMC_ADDRESS, register, bytes([value]))


class Qmc5883l:
    """QST QMC5883L, on most boards sold as HMC5883L: little-endian, x, y, z."""

    DATA, STATUS, CONTROL_1, CONTROL_2, PERIOD, CHIP_ID = 0x00, 0x06, 0x09, 0x0A, 0x0B, 0x0D
    OVERSAMPLE_512_8_GAUSS_50_HZ = 0x15
    SOFT_RESET = 0x80
    POINTER_ROLLS = 0x40
    LSB_PER_GAUSS = 3000.0

    def __init__(self, bus: I2cBus) -> None:
        self._bus = bus
        self.name = "QMC5883L"
        self.overflows = 0

    def configure(self) -> bool:
        """Set up and read back: its id, 0xFF, is also what a floating bus reads."""
        if self._bus.read(QMC_ADDRESS, self.CHIP_ID, 1) != b"\xff":
            return False
        self._write(self.CONTROL_2, self.SOFT_RESET)
        self._write(self.PERIOD, 0x01)
        self._write(self.CONTROL_2, self.POINTER_ROLLS)
        self._write(self.CONTROL_1, self.OVERSAMPLE_512_8_GAUSS_50_HZ)
        wanted = bytes([self.OVERSAMPLE_512_8_GAUSS_50_HZ, self.POINTER_ROLLS, 0x01])
        return self._bus.read(QMC_ADDRESS, self.CONTROL_1, 3) == wanted

    def read(self) -> Field | None:
        """A new reading; an overflow is none."""
        status = self._bus.read(QMC_ADDRESS, self.STATUS, 1)[0]
        if not status & 0x01:
            return None
        x, y, z = struct.unpack("<3h", self._bus.read(QMC_ADDRESS, self.DATA, 6))
        if status & 0x02:
            self.overflows += 1
            return None
        return x / self.LSB_PER_GAUSS, y / self.LSB_PER_GAUSS, z / self.LSB_PER_GAUSS

    def _write(self, register: int, value: int) -> None:
        self._bus.write(QMC_ADDRESS, register, bytes([value]))
