# SPDX-License-Identifier: MIT
"""The way driven so far, kept in the odom frame, told in the map frame as known by now.

SLAM corrects the map's nodes after the fact, and what was driven between them must follow.
In go odometry poses as they come and, when asked, the anchors: instants at which SLAM says
where the base was. Between two anchors the correction grows with the way driven.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose, inverse

TURN_LENGTH_M_PER_RAD = 0.2  # a turn on the spot drifts as much as this way, for the weights
_WIDTH = 4  # stamp, x, y, heading


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchor:
    """At `stamp_s` the odometry said `odom_from_base`; by now SLAM says `map_from_base`."""

    stamp_s: float
    odom_from_base: Pose2
    map_from_base: Pose2


class TrajectoryRecorder:
    """Odometry poses, 32 bytes each, in the order of time."""

    def __init__(self) -> None:
        self._rows = array("d")

    def __len__(self) -> int:
        """How many poses have been recorded."""
        return len(self._rows) // _WIDTH

    def add(self, stamp_s: float, odom_from_base: Pose2) -> None:
        """Record one pose; stamps may repeat but not go back."""
        if self._rows and stamp_s < self._rows[-_WIDTH]:
            raise ValueError(f"stamp {stamp_s:.6f} s after {self._rows[-_WIDTH]:.6f} s")
        self._rows.extend(
            (stamp_s, odom_from_base.x_m, odom_from_base.y_m, odom_from_base.heading_rad)
        )

    def odometry(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (N,) and odom_from_base (N, 3) as recorded."""
        # A copy in one step: while numpy reads an array, another thread may not extend it.
        rows = np.frombuffer(self._rows.tobytes()).reshape(-1, _WIDTH)
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def corrected(
        self, anchors: Sequence[Anchor], carried_s: Sequence[tuple[float, float]] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Stamps (N,) and map_from_base (N, 3), every past pose moved with the anchors.

        At an anchor the answer is the anchor's pose. In between each pose is carried by both
        neighbours and blended by the share of the way driven; outside, by the nearest one.
        Of times (from, to) in which somebody carried the robot nothing is told, and no anchor
        counts beyond them.
        """
        stamps_s, odom_from_base = self.odometry()
        parts, begun_s = [], -math.inf
        for from_s, to_s in [*carried_s, (math.inf, math.inf)]:
            of = (begun_s <= stamps_s) & (stamps_s <= from_s)
            own = [anchor for anchor in anchors if begun_s <= anchor.stamp_s <= from_s]
            parts.append((stamps_s[of], correct(stamps_s[of], odom_from_base[of], own)))
            begun_s = to_s
        told_s, poses = zip(*parts, strict=True)
        return np.concatenate(told_s), np.concatenate(poses)


def correct(
    stamps_s: FloatArray, odom_from_base: FloatArray, anchors: Sequence[Anchor]
) -> FloatArray:
    """Carry odometry poses (N, 3) into the map frame by `anchors` (any order, perhaps none)."""
    if not anchors or not len(stamps_s):
        return odom_from_base.copy()
    anchors = sorted(anchors, key=lambda anchor: anchor.stamp_s)
    anchor_stamps_s = np.array([anchor.stamp_s for anchor in anchors])
    anchor_odom = np.stack([anchor.odom_from_base.as_array() for anchor in anchors])
    anchor_map = np.stack([anchor.map_from_base.as_array() for anchor in anchors])
    map_from_odom = compose(anchor_map, inverse(anchor_odom))

    after = np.searchsorted(anchor_stamps_s, stamps_s, side="right")
    first = np.clip(after - 1, 0, len(anchors) - 1)
    second = np.clip(after, 0, len(anchors) - 1)
    weights = _share_of_way(stamps_s, odom_from_base, anchor_stamps_s, first, second)

    by_first = compose(map_from_odom[first], odom_from_base)
    by_second = compose(map_from_odom[second], odom_from_base)
    blended = by_first + weights[:, None] * (by_second - by_first)
    turn = wrap_rad(by_second[:, 2] - by_first[:, 2])
    blended[:, 2] = wrap_rad(by_first[:, 2] + weights * turn)
    return blended


def _share_of_way(
    stamps_s: FloatArray,
    odom_from_base: FloatArray,
    anchor_stamps_s: FloatArray,
    first: np.ndarray,
    second: np.ndarray,
) -> FloatArray:
    """(N,) in [0, 1]: how much of the way from anchor `first` to `second` has been driven."""
    steps = between(odom_from_base[:-1], odom_from_base[1:])
    lengths = np.hypot(steps[:, 0], steps[:, 1]) + TURN_LENGTH_M_PER_RAD * np.abs(steps[:, 2])
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    way_at_anchors = np.interp(anchor_stamps_s, stamps_s, way)
    start, stop = way_at_anchors[first], way_at_anchors[second]
    span = stop - start
    driven = np.clip(way - start, 0.0, span)
    share: FloatArray = np.divide(driven, span, out=np.zeros_like(span), where=span > 0.0)
    # No way between two anchors: without odometry, or standing; then time has to do.
    pause_s = anchor_stamps_s[second] - anchor_stamps_s[first]
    elapsed_s = np.clip(stamps_s - anchor_stamps_s[first], 0.0, pause_s)
    np.divide(elapsed_s, pause_s, out=share, where=(span <= 0.0) & (pause_s > 0.0))
    return share
