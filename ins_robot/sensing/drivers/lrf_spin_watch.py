# SPDX-License-Identifier: MIT
"""Watches the rotor of the laser range finder (LRF): set speed too low, stalled, or fine.

The driver feeds it packets and asks for its verdicts; pure, time is an argument. Error codes
are those of a real XV-11 spinning down: below some speed it goes on sending packets, with "too
slow" in place of every distance.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.sensing.drivers.lrf_codec import BEAMS_PER_TURN, PacketBatch

SLOW_CODE = 0x22  # seen at 183-207 rpm
VERY_SLOW_CODE = 0x52  # every beam at 167 rpm and below
SILENCE_MAX_S = 0.5
TOO_SLOW_MAX_S = 2.0
_SHARE_MAX = 0.5  # "most beams"


class SpinWatch:
    """Speed and life of the rotor while the motor is on.

    Attributes
    ----------
    set_rpm : float
        The set speed in force.
    is_steady : bool
        A full turn's worth of beams came at the set speed since the last start.
    """

    def __init__(self, config: LrfConfig) -> None:
        self._config = config
        self.set_rpm = config.rpm
        self.is_steady = False
        self._ceiling_rpm = config.rpm_max
        self._rpm = math.nan
        self._start_s = math.nan  # the motor, or a new set speed
        self._heard_s: float | None = None
        self._usable_s = math.nan  # last time that most beams were not too slow
        self._at_speed_s = math.nan
        self._beams = 0  # of the present window, a full turn long
        self._slow_beams = 0

    def confirm(self, set_rpm: float) -> None:
        """The controller says which set speed it took; less than asked for is its limit."""
        if set_rpm < self.set_rpm:
            self._ceiling_rpm = min(self._ceiling_rpm, set_rpm)
        self.set_rpm = set_rpm

    def start(self, now_s: float) -> None:
        """The motor was switched on, or the set speed changed."""
        self.is_steady = False
        self._start_s = self._usable_s = self._at_speed_s = now_s
        self._heard_s = None
        self._beams = self._slow_beams = 0

    def see(self, batch: PacketBatch, rpm: float, now_s: float) -> None:
        """Take note of packets that just came; `rpm` is the filtered speed."""
        if not len(batch):
            return
        codes = batch.error_code
        slow = int(np.count_nonzero((codes == SLOW_CODE) | (codes == VERY_SLOW_CODE)))
        beams = codes.size
        self._rpm = rpm
        if self._heard_s is None or slow < _SHARE_MAX * beams:
            self._usable_s = now_s
        self._heard_s = now_s
        if abs(rpm - self.set_rpm) > self._config.rpm_tolerance * self.set_rpm:
            self._beams = self._slow_beams = 0
            return
        if self._beams >= BEAMS_PER_TURN:  # judged; next window
            self._beams = self._slow_beams = 0
        self._at_speed_s = now_s
        self._beams += beams
        self._slow_beams += slow
        if self._beams >= BEAMS_PER_TURN and not self._is_mostly_slow:
            self.is_steady = True

    @property
    def _is_mostly_slow(self) -> bool:
        return self._slow_beams > _SHARE_MAX * self._beams

    def faster_rpm(self) -> float | None:
        """The higher set speed to try, when most beams of a turn at this one are too slow.

        None when all is well, or when `rpm_max` or the controller's own limit is reached.
        """
        if self._beams < BEAMS_PER_TURN or not self._is_mostly_slow:
            return None
        faster = min(self.set_rpm + self._config.rpm_step, self._ceiling_rpm)
        return faster if faster > self.set_rpm else None

    def fault(self, now_s: float) -> str | None:
        """What is wrong with the rotor, in words; None when nothing is."""
        config = self._config
        if self._heard_s is None:
            silence_s, limit_s = now_s - self._start_s, config.spin_up_timeout_s / 2.0
        else:
            silence_s, limit_s = now_s - self._heard_s, SILENCE_MAX_S
        if silence_s > limit_s:
            return f"no good packet for {silence_s:.1f} s (limit {limit_s:g} s)"
        slow_s = now_s - self._usable_s
        if self._heard_s is not None and slow_s > TOO_SLOW_MAX_S:
            return (
                f"only 'too slow' readings for {slow_s:.1f} s (limit {TOO_SLOW_MAX_S:g} s) at "
                f"{self._rpm:.0f} rpm, set {self.set_rpm:.0f} rpm"
            )
        off_s = now_s - self._at_speed_s
        if off_s > config.spin_up_timeout_s:
            return (
                f"not at the set speed for {off_s:.1f} s (limit {config.spin_up_timeout_s:g} "
                f"s): {self._rpm:.0f} rpm, set {self.set_rpm:.0f} rpm"
            )
        return None
