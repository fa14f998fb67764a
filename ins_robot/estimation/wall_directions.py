# SPDX-License-Identifier: MIT
"""The directions a building's walls run in, a compass that does not drift.

Walls are built square: in most scans most walls run along one direction or across it. Its
heading, known up to quarter turns, ties a node to all that saw the same one, however far apart
and with no loop between them. What is slanted starts a direction of its own; what is only a
little off square fades in the graph, whose edges know better. The idea is that of structural
SLAM (Coughlan & Yuille 1999 for images; Peasley et al. 2012 for pose graphs).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.estimation.pose_graph import PoseGraph
from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.surfels import Surfels

QUARTER_RAD = math.pi / 2.0
BIN_RAD = math.radians(0.5)
PEAK_STD_RAD = math.radians(1.5)  # walls this much apart still make one direction
PEAK_HALF_RAD = math.radians(4.0)
REFINEMENTS = 3
TILT_MIN_RAD = math.radians(1.0)  # no single surfel counts for more
SURFELS_MIN = 20
SHARE_MIN = 0.4  # of what is flat: in a round room the best direction means nothing
OWN_SPREAD = 0.75  # of a surfel's tilt: so much walls spread; what spreads more is a mixture
VOTERS = 6.0  # neighbouring surfels share their readings, and tell as much as one
STD_MAX_RAD = math.radians(2.0)  # scans among themselves know better than a vaguer direction
SHARP_STD_RAD = math.radians(0.6)
SHARP_WITHIN_M = 10.0  # where sharp directions are to be had, vague ones are left alone
BUILT_STD_RAD = math.radians(0.4)  # as true as walls are built
SAME_WALLS_M = 2.0  # after less than this the same walls are seen, and err the same way
SAME_RAD = math.radians(4.0)
APART_RAD = math.radians(10.0)  # nearer to a known direction a new one is not believed
OFF_STDS = 1.0  # a node that far off its direction is worth relaxing the graph for


@dataclass(frozen=True, slots=True)
class WallDirection:
    """The heading, in the base frame and up to quarter turns, that most walls run along."""

    heading_rad: float
    std_rad: float


def wall_direction(surfels: Surfels) -> WallDirection | None:
    """The one direction that stands out among surfels spread evenly; None where none does."""
    flat = surfels.is_flat
    if flat.sum() < SURFELS_MIN:
        return None
    headings = np.arctan2(surfels.normals[flat, 1], surfels.normals[flat, 0])
    tilts = surfels.tilt_std_rad[flat]
    weights = 1.0 / (tilts**2 + TILT_MIN_RAD**2)
    bins = np.arange(0.0, QUARTER_RAD, BIN_RAD)
    votes = _bell(wrap_quarter_rad(headings - bins[:, None])) @ weights
    heading = float(bins[np.argmax(votes)])
    for _ in range(REFINEMENTS):
        off = wrap_quarter_rad(headings - heading)
        share = weights * _bell(off)
        heading += float(share @ off / share.sum())
    off = wrap_quarter_rad(headings - heading)
    near = np.abs(off) < PEAK_HALF_RAD
    if weights[near].sum() < SHARE_MIN * weights.sum() or near.sum() < SURFELS_MIN:
        return None
    variance = float(np.average(off[near] ** 2, weights=weights[near]))
    own = OWN_SPREAD**2 * float(np.average(tilts[near] ** 2, weights=weights[near]))
    mixed = max(variance - own, 0.0)
    std_rad = math.sqrt(variance * VOTERS / near.sum() + mixed)
    if std_rad > STD_MAX_RAD:
        return None
    return WallDirection(float(wrap_quarter_rad(heading)), std_rad)


class WallDirections:
    """The directions of a building so far, as a graph of nodes holds them."""

    def __init__(self) -> None:
        self._looked_at_m = self._sharp_at_m = -math.inf

    def see(self, graph: PoseGraph, node: int, surfels: Surfels, travelled_m: float) -> bool:
        """Tie a node to its direction; whether it is off by enough to relax the graph.

        `surfels` are those of its scan, base frame; `travelled_m` is the way driven so far.
        """
        if travelled_m - self._looked_at_m < SAME_WALLS_M:
            return False
        seen = wall_direction(surfels)
        if seen is None:
            return False
        if seen.std_rad <= SHARP_STD_RAD:
            self._sharp_at_m = travelled_m
        elif travelled_m - self._sharp_at_m < SHARP_WITHIN_M:
            return False
        self._looked_at_m = travelled_m
        at_rad = float(graph.poses[node, 2]) + seen.heading_rad
        std_rad = math.hypot(seen.std_rad, BUILT_STD_RAD)
        off = wrap_quarter_rad(at_rad - graph.directions_rad)
        if not len(off) or np.abs(off).min() > APART_RAD:
            graph.add_sight(node, graph.add_direction(at_rad), -seen.heading_rad, std_rad)
            return False
        direction = int(np.argmin(np.abs(off)))
        if abs(off[direction]) > SAME_RAD:
            return False
        # the heading at which the node would see its direction just so
        turned = float(graph.poses[node, 2] - off[direction] - graph.directions_rad[direction])
        graph.add_sight(node, direction, turned, std_rad)
        return abs(float(off[direction])) > OFF_STDS * std_rad


def wrap_quarter_rad(angle_rad: FloatArray | float) -> FloatArray:
    """Angles modulo quarter turns, in [-pi/4, pi/4)."""
    return np.asarray((np.asarray(angle_rad) + QUARTER_RAD / 2) % QUARTER_RAD - QUARTER_RAD / 2)


def _bell(off_rad: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * (off_rad / PEAK_STD_RAD) ** 2))
