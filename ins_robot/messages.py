# SPDX-License-Identifier: MIT
"""What crosses a boundary between packages: frozen, stamped, units in names.

`stamp_s` is host monotonic time (a log brings its own) of the first byte of the datum. Arrays
are float64 unless said otherwise and read-only after construction. B = beams.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2

REPEATED_UNKNOWN = 9.0  # of odometry that nobody has looked into


def _freeze(*arrays: np.ndarray | None) -> None:
    for array in arrays:
        if array is not None:
            array.flags.writeable = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """One reading of gyro and, when it had a new one, compass.

    `yaw_rate_radps` is about +z (counter-clockwise), raw scale applied, bias not removed.
    `field_gauss` is the magnetic field in the base frame's x and y (z third), None without a
    new reading.
    """

    stamp_s: float
    yaw_rate_radps: float
    field_gauss: tuple[float, float, float] | None = None
    temperature_c: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelSample:
    """One telemetry frame of the motor microcontroller (MCU).

    `counts` are the three encoder totals, unwrapped by the driver, sign as configured.
    `device_s` is MCU time, unwrapped. `fault` is the name of the latched fault, "" for none.
    """

    stamp_s: float
    device_s: float
    counts: tuple[int, int, int]
    bumper: bool = False
    cliff: bool = False
    emergency_stop: bool = False
    fault: str = ""
    battery_v: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserScan:
    """Ranges by bearing, in the LRF's own frame.

    Attributes
    ----------
    stamp_s : float
        Time of the first beam (for a combined scan: the time its pose belongs to).
    bearings_rad : (B,)
        Counter-clockwise from the LRF's x axis.
    ranges_m : (B,)
        NaN where there is no reading.
    range_std_m : (B,)
        Standard deviation of each range; larger where the return was weak. NaN with the range.
    beam_offsets_s : (B,)
        Time of each beam after `stamp_s`; zeros once de-skewed, or when standing.
    range_max_m : float
        No reading beyond this was accepted.
    rpm : float
        Rotation speed; NaN when the log does not tell.
    valid_counts : (B,) integer
        How many revolutions agreed on the beam (1 or 0 for a single revolution).
    is_free_when_silent : bool
        True when "no reading" means that nothing was there (never on an XV-11).
    """

    stamp_s: float
    bearings_rad: FloatArray
    ranges_m: FloatArray
    range_std_m: FloatArray
    beam_offsets_s: FloatArray
    range_max_m: float
    rpm: float = math.nan
    valid_counts: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    is_free_when_silent: bool = False

    def __post_init__(self) -> None:
        _freeze(
            self.bearings_rad,
            self.ranges_m,
            self.range_std_m,
            self.beam_offsets_s,
            self.valid_counts,
        )

    @property
    def is_valid(self) -> np.ndarray:
        """(B,) bool: the beams with a reading."""
        return np.isfinite(self.ranges_m)

    def points_lrf_m(self) -> FloatArray:
        """(V, 2) end points of the V valid beams, in the LRF frame."""
        ok = self.is_valid
        r, b = self.ranges_m[ok], self.bearings_rad[ok]
        return np.stack([r * np.cos(b), r * np.sin(b)], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionIncrement:
    """Motion of the base between two stamps, in the base frame at the first.

    `covariance` is (3, 3) over (x_m, y_m, heading_rad) of `delta`. Odometry errs the same way
    again and again: against a scan it is worth `repeated` times less than its covariance says,
    or a steady bias leaks into every match.
    """

    from_stamp_s: float
    to_stamp_s: float
    delta: Pose2
    covariance: FloatArray
    repeated: float = REPEATED_UNKNOWN

    def __post_init__(self) -> None:
        _freeze(self.covariance)


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseEstimate:
    """A pose with its covariance (3, 3) over (x_m, y_m, heading_rad), in the named frame."""

    stamp_s: float
    pose: Pose2
    covariance: FloatArray
    frame: str = "map"

    def __post_init__(self) -> None:
        _freeze(self.covariance)

    @property
    def position_std_m(self) -> float:
        """Root of the trace of the position block: one number for 'how lost'."""
        return math.sqrt(max(0.0, float(self.covariance[0, 0] + self.covariance[1, 1])))


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityCommand:
    """Wanted velocity of the base, in the base frame."""

    vx_mps: float = 0.0
    vy_mps: float = 0.0
    yaw_rate_radps: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedPath:
    """Where to drive: way points in the map frame, and the heading to arrive with.

    `points_m` is (N, 2), first the robot's place, last the goal. `headings_rad`, (N,), is what
    the robot should face there; an omni base turns while it drives.
    """

    points_m: FloatArray
    headings_rad: FloatArray

    def __post_init__(self) -> None:
        _freeze(self.points_m, self.headings_rad)

    @property
    def length_m(self) -> float:
        """Length of the polyline."""
        return float(np.hypot(*np.diff(self.points_m, axis=0).T).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Something that happened between the data: a scan begun or ended, a command, a verdict.

    `kind` is a word of docs/protocols.md; `payload` holds JSON values only.
    """

    stamp_s: float
    kind: str
    payload: dict[str, Any] = field(default_factory=dict)
