# SPDX-License-Identifier: MIT
"""Gyro and wheels: noise and drift at rest, errors of odometry over half a metre.

The wheels are judged by a camera (LEGO robot) and by a gyro (Botvac); both robots have two
wheels. What a constant scale would explain is taken off: their logs do not say their geometry.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ins_robot.config import SimulationConfig
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.logs.lego import read_lego
from sensor_study import recordings, simulated
from sensor_study.quantity import Quantity
from sensor_study.recordings import Botvac

SEEDS = (0, 1)
CHUNK_S = 1.0
QUIET_DPS = 0.06
"""More spread than this within a second: the robot was still rocking."""
SEGMENT_M = 0.5
GYRO_S = 120.0


def gyro(real: list[Botvac], simulation: SimulationConfig) -> list[Quantity]:
    caveat = "another gyro than the MPU6050; its bias at start was already taken off"
    chunks = [quiet_chunks(r.gyro_s, r.rate_dps, _is_at_rest(r)) for r in real]
    simulations = []
    for seed in SEEDS:
        stamps_s, rate_dps = simulated.listen_to_gyro(simulation, GYRO_S, seed)
        simulations.append(quiet_chunks(stamps_s, rate_dps, np.ones(len(stamps_s), dtype=bool)))
    source = "Botvac, 2 recordings, at rest"
    return [
        Quantity(
            "gyro noise at rest, std of 1 s",
            "deg/s",
            source,
            caveat,
            [c[2] for c in chunks],
            [c[2] for c in simulations],
        ),
        Quantity(
            "gyro bias, size of change in 10 to 40 s",
            "deg/s per sqrt s",
            source,
            caveat + "; few standstills",
            [drifts(*c[:2]) for c in chunks],
            [drifts(*c[:2]) for c in simulations],
        ),
    ]


def _is_at_rest(recording: Botvac) -> np.ndarray:
    """(G,) bool: gyro rows between rows of wheels that say the same."""
    steps_m = np.abs(np.diff(recording.wheels_m, axis=0)).max(axis=1)
    interval = np.searchsorted(recording.wheels_s, recording.gyro_s) - 1
    inside = (interval >= 0) & (interval < len(steps_m))
    return inside & (steps_m[np.clip(interval, 0, len(steps_m) - 1)] < 1e-3)


def quiet_chunks(
    stamps_s: FloatArray, rate_dps: FloatArray, is_at_rest: np.ndarray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, means and standard deviations of whole seconds at rest."""
    second = np.floor(stamps_s / CHUNK_S).astype(int)
    rows = []
    for number in np.unique(second):
        inside = second == number
        if inside.sum() < 60 or not is_at_rest[inside].all():
            continue
        spread = float(rate_dps[inside].std())
        if spread < QUIET_DPS:
            rows.append((stamps_s[inside].mean(), rate_dps[inside].mean(), spread))
    times_s, means, spreads = np.array(rows).T
    return times_s, means, spreads


def drifts(times_s: FloatArray, means_dps: FloatArray) -> FloatArray:
    """Size of changes of the mean in 10 to 40 s, over the root of the time."""
    later, earlier = np.nonzero(
        (times_s[:, None] - times_s > 10.0) & (times_s[:, None] - times_s < 40.0)
    )
    if not len(later):  # two standstills, far apart
        later, earlier = np.array([len(times_s) - 1]), np.array([0])
    change: FloatArray = np.abs(means_dps[later] - means_dps[earlier]) / np.sqrt(
        times_s[later] - times_s[earlier]
    )
    return change


def wheels(botvac: list[Botvac], lego: Path, simulation: SimulationConfig) -> list[Quantity]:
    two_wheels = "two-wheeled robots: no omni base among the recordings"
    ways, turns = lego_errors(lego)
    drives = [simulated.drive_around(simulation, 30.0, seed) for seed in SEEDS]
    return [
        Quantity(
            "odometry, way of 0.5 m",
            "share",
            "LEGO robot against camera, 2 halves",
            two_wheels + "; its scale is unresolved and taken off; camera to 3 mm",
            np.array_split(ways, 2),
            [way_errors(*drive) for drive in drives],
        ),
        Quantity(
            "odometry, turn in 0.5 m",
            "deg",
            "LEGO against camera, 2 halves; Botvac wheels against gyro",
            two_wheels,
            [*np.array_split(turns, 2), botvac_turn_errors_deg(botvac[0])],
            [turn_errors_deg(*drive) for drive in drives],
        ),
    ]


def segment_ends(poses: FloatArray) -> np.ndarray:
    """Indexes that part the way of (N, 2+) poses into segments of `SEGMENT_M`."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    way_m = np.concatenate([[0.0], np.cumsum(steps)])
    return np.searchsorted(way_m, np.arange(0.0, way_m[-1], SEGMENT_M))


def way_errors(true: FloatArray, odometry: FloatArray) -> FloatArray:
    """True chord over odometry's chord of each segment, less the mean ratio."""
    ends = segment_ends(odometry)
    chords = [np.hypot(*np.diff(p[ends, :2], axis=0).T) for p in (true, odometry)]
    ratio: FloatArray = chords[0] / chords[1]
    return ratio / ratio.mean() - 1.0


def turn_errors_deg(true: FloatArray, odometry: FloatArray) -> FloatArray:
    """Error of each segment's turn, less what a wrong track (a scale) would explain."""
    ends = segment_ends(odometry)
    turned = [np.diff(np.unwrap(p[:, 2])[ends]) for p in (true, odometry)]
    scale = (turned[0] @ turned[1]) / (turned[1] @ turned[1])
    error: FloatArray = np.degrees(turned[0] - scale * turned[1])
    return error


def lego_errors(directory: Path) -> tuple[FloatArray, FloatArray]:
    """Way errors and turn errors (deg) of the LEGO robot's odometry by its camera."""
    log = read_lego(directory)
    stamps_s = np.array([record.stamp_s for record in log.records])
    odometry = np.array([record.odom_from_base.as_array() for record in log.records])
    seen_s, seen_m = recordings.read_camera_m(directory)
    true = np.stack([np.interp(stamps_s, seen_s, seen_m[:, k]) for k in (0, 1)], axis=1)
    ends = segment_ends(odometry)
    turned = [_bends(p[ends, :2]) for p in (true, odometry)]
    return way_errors(true, odometry), np.degrees(wrap_rad(turned[0] - turned[1]))


def _bends(points: FloatArray) -> FloatArray:
    """Angle between each chord and the next: a camera sees no heading."""
    dx, dy = np.diff(points, axis=0).T
    bends: FloatArray = wrap_rad(np.diff(np.arctan2(dy, dx)))
    return bends


def botvac_turn_errors_deg(recording: Botvac) -> FloatArray:
    """Turn by the wheels against turn by the gyro, over each half metre of wheels' way."""
    way_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(recording.wheels_m.mean(axis=1))))])
    ends = np.searchsorted(way_m, np.arange(0.0, way_m[-1], SEGMENT_M))
    wheels = np.diff(np.diff(recording.wheels_m, axis=1)[ends, 0])
    heading = np.concatenate(
        [[0.0], np.cumsum(recording.rate_dps[:-1] * np.diff(recording.gyro_s))]
    )
    gyro_deg = np.diff(np.interp(recording.wheels_s[ends], recording.gyro_s, heading))
    per_m = (gyro_deg @ wheels) / (wheels @ wheels)
    error: FloatArray = gyro_deg - per_m * wheels
    return error
