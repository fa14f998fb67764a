# SPDX-License-Identifier: MIT
"""A device's own clock, mapped to the host's: stamps without the jitter of the line.

Frames arrive late, never early, so the least delay seen tells the offset. It follows an
earlier arrival at once and a later one slowly, and so also a crystal that is off. After
Klipper's clocksync, without its regression: an offset is all that a stamp needs.
"""

from __future__ import annotations

AGEING_S = 10.0  # a clock off by 100 ppm lags this x 100 ppm = 1 ms
STEP_MAX_MS = 10_000  # a frame that claims a longer step is not believed


class DeviceClock:
    """Unwraps a 32-bit millisecond clock and tells host time for it."""

    def __init__(self) -> None:
        self.device_s = 0.0
        self._time_ms: int | None = None
        self._elapsed_ms = 0
        self._offset_s = 0.0

    def stamp(self, time_ms: int, arrival_s: float) -> float | None:
        """Host time in s of device time `time_ms`: never after `arrival_s`, never falling.

        None when the device's clock did not move on by a believable step. Afterwards `device_s`
        is the device's time since the first frame.
        """
        if self._time_ms is None:
            self._time_ms = time_ms
            self._offset_s = arrival_s
            return arrival_s
        step_ms = (time_ms - self._time_ms) & 0xFFFFFFFF
        if not 0 < step_ms <= STEP_MAX_MS:
            return None
        self._time_ms = time_ms
        self._elapsed_ms += step_ms
        self.device_s = self._elapsed_ms * 1e-3
        late_s = arrival_s - self.device_s - self._offset_s
        if late_s <= 0.0:
            self._offset_s += late_s
            return arrival_s
        self._offset_s += late_s * min(1.0, step_ms * 1e-3 / AGEING_S)
        return self.device_s + self._offset_s
