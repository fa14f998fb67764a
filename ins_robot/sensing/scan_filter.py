# SPDX-License-Identifier: MIT
"""Several revolutions taken while standing -> one scan, beam by beam; and parts of a scan.

The paper samples "multiple realizations", about five, against what reflectivity and the rotor's
speed do to single ones. Between the LRF's driver and SLAM; pure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ins_robot.config import LrfConfig
from ins_robot.errors import DeviceError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.messages import LaserScan

_WITNESSES_MIN = 2
_AGREE_STDS = 4.0
_AGREE_SHARE = 0.02  # of the range: beams hop a little on slanted walls as the speed ripples


def is_at_speed(revolution: LaserScan, config: LrfConfig, set_rpm: float | None = None) -> bool:
    """Whether a revolution ran within `rpm_tolerance` of the set speed.

    `set_rpm` is the set speed in force (the driver's `set_rpm`), None for the configured one.
    A revolution of unknown speed (NaN, from a log) counts as good.
    """
    wanted_rpm = config.rpm if set_rpm is None else set_rpm
    off_rpm = abs(revolution.rpm - wanted_rpm)
    return math.isnan(off_rpm) or off_rpm <= config.rpm_tolerance * wanted_rpm


def combine(
    revolutions: Sequence[LaserScan], config: LrfConfig, set_rpm: float | None = None
) -> LaserScan:
    """Beam-by-beam median of the revolutions at the set speed, from a robot that stands.

    - A reading agrees when it is within 4 standard deviations plus 2 % of the range of the
      median of the valid ones (the lower of two middle ones: their mean could be a wall where
      there is none). The result is the median of those that agree.
    - A beam stays if at least two readings agree (one, when there is only one revolution) and
      they are the majority of the beam's valid readings. A beam across an edge, or one that
      fell on a mixed pixel, jumps between revolutions and goes; a dark wall that answers in
      two revolutions of five stays. A distance seen once in five is not believed.
    - `valid_counts` tells how many readings agreed. `range_std_m` is the error floor plus the
      larger of model and observed spread, as it averages out over that many; the floor
      (quantisation, calibration) does not.
    - The stamp is the middle of the measurement; beam offsets are zero.

    Parameters
    ----------
    revolutions : sequence of LaserScan
        With the same bearings, as one driver gives them.
    set_rpm : float, optional
        The set speed in force; None for the configured one.

    Raises
    ------
    DeviceError
        When no revolution ran at the set speed, or none was given.
    """
    used = [scan for scan in revolutions if is_at_speed(scan, config, set_rpm)]
    if not used:
        speeds = ", ".join(f"{scan.rpm:.0f}" for scan in revolutions) or "none"
        wanted_rpm = config.rpm if set_rpm is None else set_rpm
        raise DeviceError(
            f"lrf: none of {len(revolutions)} revolutions ran at {wanted_rpm:.0f} rpm +- "
            f"{100.0 * config.rpm_tolerance:.0f} % (they ran at: {speeds}): motor still "
            f"spinning up, or rotor stiff"
        )
    ranges_m = np.stack([scan.ranges_m for scan in used])
    stds_m = np.stack([scan.range_std_m for scan in used])
    median_m, _ = _middle(ranges_m)
    gate_m = _AGREE_STDS * stds_m + _AGREE_SHARE * median_m
    agrees = np.abs(ranges_m - median_m) <= gate_m  # NaN agrees with nothing
    agree_counts = agrees.sum(axis=0)
    is_kept = (agree_counts >= min(_WITNESSES_MIN, len(used))) & (
        2 * agree_counts > np.isfinite(ranges_m).sum(axis=0)
    )
    counts = np.where(is_kept, agree_counts, 0)
    divisor = np.maximum(counts, 1)
    lower_m, upper_m = _middle(np.where(agrees, ranges_m, np.nan))
    combined_m = np.where(is_kept, 0.5 * (lower_m + upper_m), np.nan)
    floor2 = config.range_std_floor_m**2
    model2 = np.where(agrees, stds_m * stds_m, 0.0).sum(axis=0) / divisor
    offsets_m = np.where(agrees, ranges_m - combined_m, 0.0)
    spread2 = (offsets_m * offsets_m).sum(axis=0) / divisor  # without the outliers: robust
    # A median of n > 2 has at most pi / 2 times the variance of their mean.
    share = np.where(counts > _WITNESSES_MIN, 0.5 * math.pi, 1.0) / divisor
    std_m = np.sqrt(floor2 + share * np.maximum(model2 - floor2, spread2))
    last = used[-1]
    end_s = last.stamp_s + float(last.beam_offsets_s.max(initial=0.0))
    return LaserScan(
        stamp_s=0.5 * (used[0].stamp_s + end_s),
        bearings_rad=last.bearings_rad,
        ranges_m=combined_m,
        range_std_m=np.where(is_kept, std_m, np.nan),
        beam_offsets_s=np.zeros(len(combined_m)),
        range_max_m=last.range_max_m,
        rpm=float(np.median([scan.rpm for scan in used])),
        valid_counts=counts.astype(np.int64),
        is_free_when_silent=last.is_free_when_silent,
    )


def _middle(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The two middle values of each column of (R, B), twice the same if odd; NaN if none."""
    # Not np.nanmedian: that gives their mean only, and warns of columns without any.
    ordered = np.sort(values, axis=0)  # NaN last
    counts = np.isfinite(values).sum(axis=0)
    lower = np.take_along_axis(ordered, np.maximum(counts - 1, 0)[None, :] // 2, axis=0)[0]
    upper = np.take_along_axis(ordered, counts[None, :] // 2, axis=0)[0]
    return lower, upper


def select_sector(scan: LaserScan, centre_rad: float, half_width_rad: float) -> LaserScan:
    """The beams within `half_width_rad` of `centre_rad`, in counter-clockwise order.

    Beams outside are left out, not NaN: a NaN says that one looked and saw nothing. The first
    beam is the sector's right edge, so neighbours in the array are neighbours in space. Half a
    turn or more keeps every beam, in the order given.
    """
    if half_width_rad >= math.pi:
        return scan
    from_centre_rad = wrap_rad(scan.bearings_rad - centre_rad)
    inside = np.flatnonzero(np.abs(from_centre_rad) <= half_width_rad + 1e-9)
    return take_beams(scan, inside[np.argsort(from_centre_rad[inside], kind="stable")])


def take_beams(scan: LaserScan, beams: np.ndarray) -> LaserScan:
    """The scan with only the beams of these indices (or this mask), in this order."""
    counts = scan.valid_counts
    return LaserScan(
        stamp_s=scan.stamp_s,
        bearings_rad=scan.bearings_rad[beams],
        ranges_m=scan.ranges_m[beams],
        range_std_m=scan.range_std_m[beams],
        beam_offsets_s=scan.beam_offsets_s[beams],
        range_max_m=scan.range_max_m,
        rpm=scan.rpm,
        valid_counts=counts[beams] if len(counts) else counts,
        is_free_when_silent=scan.is_free_when_silent,
    )
