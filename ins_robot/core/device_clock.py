# SPDX-License-Identifier: MIT
"""A microcontroller's clock on the host's: when a telemetry frame was really taken.

A frame may arrive late, by a busy bus or loop, but never early. So the smallest arrival time
minus device time seen is the offset, and it creeps up as fast as two quartz clocks may part
(the idea of Klipper's `clocksync`).
"""

from __future__ import annotations

CREEP = 2e-4  # 200 ppm
STEP_MIN_S = 1e-4
LOST_S = 1.0  # later than this is no lateness: one of the clocks stood still


class DeviceClock:
    """Turns (arrival, device time) pairs into strictly increasing host stamps."""

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._device_s = 0.0
        self._host_s = 0.0

    def restart(self) -> None:
        """The device's clock began anew."""
        self._offset_s = None

    def host_stamp_s(self, arrival_s: float, device_s: float) -> float:
        """Host time at which the device's clock showed `device_s`."""
        offset_s = arrival_s - device_s
        if self._offset_s is not None:
            crept_s = self._offset_s + CREEP * (device_s - self._device_s)
            if offset_s - crept_s < LOST_S:
                offset_s = min(crept_s, offset_s)
        self._offset_s, self._device_s = offset_s, device_s
        self._host_s = max(device_s + offset_s, self._host_s + STEP_MIN_S)
        return self._host_s
