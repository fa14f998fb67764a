# SPDX-License-Identifier: MIT
"""XV-11 packets, with the time they arrived -> one `LaserScan` per revolution.

Between codec and driver; pure. The sensor sends no time, so the time of each beam is counted
back from the arrival of its packet by the rotation speed: a packet leaves right after its
fourth beam, needs 1.9 ms on the sensor's line, and may then wait in a chunk. A clock that turns
with the rotor is therefore kept just early enough that no packet arrives before it was sent.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.geometry.angles import wrap_rad
from ins_robot.messages import LaserScan
from ins_robot.sensing.drivers.lrf_codec import (
    BEAMS_PER_PACKET,
    BEAMS_PER_TURN,
    PACKET_LINE_TIME_S,
    PACKETS_PER_TURN,
    PacketBatch,
)
from ins_robot.sensing.range_error import range_std_m

_RPM_WINDOW = 31  # packets; the sensor repeats one wrong value up to 15 times
_PACKETS_MIN = PACKETS_PER_TURN // 3  # fewer are no revolution: a slow XV-11 sends two per turn
_CLOCK_LAG_S = 0.6  # how fast the clock gives in to packets that keep coming late
_NONE = PACKETS_PER_TURN  # no packet yet; above every index
_LOST_TURNS = 0.5  # later than this: packets are missing, not delayed


class RevolutionAssembler:
    """Collects packets until a revolution is full.

    Every scan has the same 360 beams, one per degree, sorted counter-clockwise over
    [-pi, pi); beams whose packet was lost, or whose reading has no distance or one outside
    `range_min_m`..`range_max_m`, are NaN. Beam offsets follow the order of measurement, so
    in order of bearing they jump where the rotation begins.
    """

    def __init__(self, config: LrfConfig) -> None:
        self._config = config
        direction = -1.0 if config.is_clockwise else 1.0
        bearings_rad = wrap_rad(
            np.radians(config.yaw_deg + direction * np.arange(float(BEAMS_PER_TURN)))
        )
        self._order = np.argsort(bearings_rad)
        self._bearings_rad = bearings_rad[self._order]
        self._recent_rpm: deque[float] = deque(maxlen=_RPM_WINDOW)
        self._rpm = math.nan
        self._parts: list[tuple[PacketBatch, slice]] = []
        self._previous = _NONE  # index of the last packet
        self._end_s = math.nan  # when its fourth beam was measured
        self._is_whole = False  # the running revolution was seen from its start
        self.revolutions = 0
        self.incomplete = 0
        self.packets_missing = 0

    @property
    def rpm(self) -> float:
        """Present speed: median of the last packets; NaN before the first."""
        return self._rpm

    def reset(self) -> None:
        """Forget the running revolution and the clock: the rotor was stopped or restarted."""
        self._recent_rpm.clear()
        self._rpm = math.nan
        self._restart()

    def push(self, batch: PacketBatch, arrival_s: float) -> list[LaserScan]:
        """Take packets that arrived together; return the revolutions they completed."""
        indexes: list[int] = batch.index.tolist()
        if not indexes:
            return []
        self._recent_rpm.extend(batch.rpm.tolist())
        self._rpm = sorted(self._recent_rpm)[len(self._recent_rpm) // 2]
        packet_s = 60.0 / (PACKETS_PER_TURN * max(self._rpm, 1.0))
        ahead = self._steps_ahead(indexes)
        self._turn_clock(ahead[-1] * packet_s, arrival_s - PACKET_LINE_TIME_S, packet_s)
        if self._previous == _NONE:
            self._is_whole = indexes[0] == 0
        scans: list[LaserScan] = []
        start = 0
        for place, index in enumerate(indexes):
            if index <= self._previous != _NONE:  # wrapped; the packet before was the last
                end_s = self._end_s - (ahead[-1] - ahead[place]) * packet_s
                self._close(batch, slice(start, place), end_s, scans)
                start = place
            self._previous = index
            if index == PACKETS_PER_TURN - 1:
                end_s = self._end_s - (ahead[-1] - ahead[place + 1]) * packet_s
                self._close(batch, slice(start, place + 1), end_s, scans)
                start = place + 1
        if start < len(indexes):
            self._parts.append((batch, slice(start, None)))
        return scans

    def _steps_ahead(self, indexes: list[int]) -> list[int]:
        """Rotation since the last packet before these, in packets: 0, then one entry each."""
        ahead = [0]
        previous = self._previous
        for index in indexes:
            step = 1 if previous == _NONE else (index - previous - 1) % PACKETS_PER_TURN + 1
            ahead.append(ahead[-1] + step)
            previous = index
        return ahead

    def _turn_clock(self, ahead_s: float, sent_s: float, packet_s: float) -> None:
        """Move the clock to the last packet, which was sent at `sent_s` at the latest."""
        expected_s = self._end_s + ahead_s
        late_s = sent_s - expected_s
        if not abs(late_s) < _LOST_TURNS * PACKETS_PER_TURN * packet_s:  # also when NaN
            self._restart()
            self._end_s = sent_s
        elif late_s < 0.0:
            self._end_s = sent_s
        else:
            self._end_s = expected_s + late_s * min(1.0, ahead_s / _CLOCK_LAG_S)

    def _restart(self) -> None:
        self._parts.clear()
        self._previous = _NONE
        self._end_s = math.nan
        self._is_whole = False

    def _close(
        self, batch: PacketBatch, places: slice, end_s: float, scans: list[LaserScan]
    ) -> None:
        """End the running revolution with these packets; `end_s` belongs to the last one."""
        parts = self._parts
        if places.start < places.stop:
            parts.append((batch, places))
        self._parts = []
        was_whole, self._is_whole = self._is_whole, True
        if not parts:
            return
        count = sum(len(part.index[where]) for part, where in parts)
        if not was_whole or count < _PACKETS_MIN:
            self.incomplete += 1
            return
        self.revolutions += 1
        self.packets_missing += PACKETS_PER_TURN - count
        scans.append(self._scan(parts, end_s))

    def _scan(self, parts: list[tuple[PacketBatch, slice]], end_s: float) -> LaserScan:
        config = self._config
        index = np.concatenate([part.index[where] for part, where in parts])
        rpm = float(np.median(np.concatenate([part.rpm[where] for part, where in parts])))
        range_m = 1e-3 * np.concatenate([part.distance_mm[where] for part, where in parts])
        is_weak = np.concatenate([part.is_weak[where] for part, where in parts])
        is_taken = (
            (range_m > 0.0)  # 0 mm without a flag does occur; invalid readings are 0 as well
            & (range_m >= config.range_min_m)
            & (range_m <= config.range_max_m)
        )
        ranges_m = np.full((PACKETS_PER_TURN, BEAMS_PER_PACKET), np.nan)
        ranges_m[index] = np.where(is_taken, range_m, np.nan)
        is_noisy = np.zeros((PACKETS_PER_TURN, BEAMS_PER_PACKET), dtype=bool)
        is_noisy[index] = is_weak
        ranges_m = ranges_m.ravel()[self._order]
        std_m = range_std_m(ranges_m, config.range_std_floor_m, config.range_std_per_m3)
        std_m[is_noisy.ravel()[self._order]] *= config.weak_return_factor
        beam_s = 60.0 / (BEAMS_PER_TURN * max(rpm, 1.0))
        last_beam = BEAMS_PER_PACKET * int(index[-1]) + BEAMS_PER_PACKET - 1
        return LaserScan(
            stamp_s=end_s - last_beam * beam_s,
            bearings_rad=self._bearings_rad,
            ranges_m=ranges_m,
            range_std_m=std_m,
            beam_offsets_s=beam_s * self._order.astype(np.float64),
            range_max_m=config.range_max_m,
            rpm=rpm,
            valid_counts=np.isfinite(ranges_m).astype(np.int64),
        )
