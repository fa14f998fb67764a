# SPDX-License-Identifier: MIT
"""What the recordings hold, taken apart for comparing: Botvac, LEGO robot, XV-11 capture.

Reads the raw rows, not what the readers of `ins_robot.logs` make of them for SLAM: nothing is
gated but what is no distance at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.logs.botvac import WHEEL_DELAY_S, read_series
from ins_robot.sensing.drivers.lrf_codec import (
    BEAMS_PER_PACKET,
    BEAMS_PER_TURN,
    PACKETS_PER_TURN,
    LrfCodec,
)
from sensor_study.standstill import Standstill

BOTVAC = ("botvac_driving_around", "botvac_rotating")
RANGE_MAX_M = 6.0
STILL_DPS, STILL_M = 0.25, 1e-3
STANDSTILL_TURNS_MIN = 6
BLOCKED_SHARE = 0.1
"""A beam with fewer readings than this in both recordings looks at the robot itself."""
STEADY_RPM = 10.0


@dataclass(frozen=True)
class Botvac:
    """One recording: stamps in seconds from its first gyro row.

    `ranges_m` (S, 360) of scans at `scan_s`, `wheels_m` (W, 2) left and right at `wheels_s`,
    `rate_dps` (G,) counter-clockwise at `gyro_s`.
    """

    name: str
    scan_s: FloatArray
    ranges_m: FloatArray
    wheels_s: FloatArray
    wheels_m: FloatArray
    gyro_s: FloatArray
    rate_dps: FloatArray

    def is_still(self) -> np.ndarray:
        """(S,) bool: scans while neither gyro nor wheels show any motion."""
        resting_dps = float(np.median(self.rate_dps[:300]))
        still = np.zeros(len(self.scan_s), dtype=bool)
        for i, stamp_s in enumerate(self.scan_s):
            low, high = np.searchsorted(self.gyro_s, [stamp_s - 0.35, stamp_s + 0.1])
            around = np.abs(self.rate_dps[low:high] - resting_dps)
            ways = [
                np.interp(stamp_s + np.array([-0.4, -0.2, 0.2]), self.wheels_s, way)
                for way in self.wheels_m.T
            ]
            still[i] = around.max(initial=0.0) < STILL_DPS and np.ptp(ways, 1).max() < STILL_M
        return still

    def standstills(self, is_open: np.ndarray) -> list[Standstill]:
        """Stretches of scans while the robot stood."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], self.is_still().astype(int), [0]])))
        return [
            Standstill(f"{self.name} {self.scan_s[a]:.0f} s", self.ranges_m[a:b], is_open)
            for a, b in edges.reshape(-1, 2)
            if b - a >= STANDSTILL_TURNS_MIN
        ]


@dataclass(frozen=True)
class Capture:
    """Steady turns of an XV-11, (T, 360) each: NaN, 0 or False where nothing was said."""

    ranges_m: FloatArray
    strength: FloatArray
    error_code: np.ndarray
    is_weak: np.ndarray
    rpm: FloatArray
    """(T, 90), by packet."""

    def part(self, which: slice) -> Capture:
        return Capture(
            self.ranges_m[which],
            self.strength[which],
            self.error_code[which],
            self.is_weak[which],
            self.rpm[which],
        )


def read_recording(path: Path) -> Botvac:
    series = read_series(path)
    scans, wheels, gyro = series["scan"], series["dist"], series["gyro_yaw"]
    start_s = gyro.stamps_s[0]
    is_range = (scans.values > 0.0) & (scans.values <= RANGE_MAX_M)
    return Botvac(
        path.stem,
        scans.stamps_s - start_s,
        np.where(is_range, scans.values, np.nan),
        wheels.stamps_s - start_s - WHEEL_DELAY_S,
        wheels.values,
        gyro.stamps_s - start_s,
        -np.degrees(gyro.values[:, 0]),
    )


def open_beams(recordings: list[Botvac]) -> np.ndarray:
    """(360,) bool: beams before which no part of the robot stands."""
    shares = [np.isfinite(r.ranges_m).mean(axis=0) for r in recordings]
    return np.max(shares, axis=0) > BLOCKED_SHARE


def decode_capture(stream: bytes) -> Capture:
    """The whole turns at steady speed in the bytes of an XV-11."""
    batch = LrfCodec().feed(stream)
    turn = np.cumsum(np.concatenate([[0], np.diff(batch.index) < 0]))
    count = int(turn[-1]) + 1
    rpm = np.full((count, PACKETS_PER_TURN), np.nan)
    rpm[turn, batch.index] = batch.rpm
    steady_rpm = float(np.median(batch.rpm))
    off_rpm = np.abs(rpm - steady_rpm).max(axis=1)  # NaN where a packet is missing
    used = off_rpm < STEADY_RPM

    def by_beam(values: np.ndarray, missing: float) -> np.ndarray:
        table = np.full((count, PACKETS_PER_TURN, BEAMS_PER_PACKET), missing)
        table[turn, batch.index] = values
        return table.reshape(count, BEAMS_PER_TURN)[used]

    distance_mm = np.where(batch.is_invalid, np.nan, batch.distance_mm)
    return Capture(
        by_beam(1e-3 * distance_mm, np.nan),
        by_beam(batch.strength, 0.0),
        by_beam(batch.error_code, 0.0).astype(int),
        by_beam(batch.is_weak, 0.0).astype(bool),
        rpm[used],
    )


def read_camera_m(directory: Path) -> tuple[FloatArray, FloatArray]:
    """Stamps (N,) and places (N, 2) of the LEGO robot as the overhead camera saw them."""
    lines = (directory / "robot4_reference.txt").read_text().splitlines()
    rows = np.array([line.split()[1:4] for line in lines if line.startswith("P")], dtype=float)
    return 1e-3 * rows[:, 0], 1e-3 * rows[:, 1:]
