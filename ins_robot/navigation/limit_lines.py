# SPDX-License-Identifier: MIT
"""Lines that the body keeps off, of boundary and zones: points in, distances out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.polygon import contains, distance_m, outline_m
from ins_robot.mapping.zones import Zone, ZoneKind

FENCE_STEP_M = 0.02  # spacing of the points that stand for a line
TINY_M = 1e-9  # a side that runs along an axis is taken to leave it by so much


class Side(Enum):
    """Where the body may be."""

    INSIDE = auto()
    OUTSIDE = auto()
    BOTH = auto()


@dataclass(frozen=True, slots=True)
class LimitLine:
    """One line (N, 2); the outline of an area ends where it begins."""

    points_m: FloatArray
    allowed: Side

    @classmethod
    def around(cls, boundary_m: Sequence[tuple[float, float]]) -> LimitLine:
        """The outline that the body stays inside of."""
        return cls(outline_m(np.array(boundary_m)), Side.INSIDE)

    @classmethod
    def of_zone(cls, zone: Zone) -> LimitLine:
        """The outline of a no-go zone, or a virtual wall."""
        points = np.array(zone.points_m)
        if zone.kind is ZoneKind.WALL:
            return cls(points, Side.BOTH)
        return cls(outline_m(points), Side.OUTSIDE)

    def room_m(self, points_m: FloatArray) -> FloatArray:
        """(P,) from points (P, 2) to the line; negative where the body may not be."""
        away = distance_m(self.points_m, points_m)
        if self.allowed is Side.BOTH:
            return away
        is_inside = contains(self.points_m[:-1], points_m)
        return np.where(is_inside == (self.allowed is Side.INSIDE), away, -away)

    def fence_m(self, low_m: FloatArray, high_m: FloatArray) -> FloatArray:
        """(M, 2) points along it, where it runs through a box with corners (2,)."""
        begins, sides = self.points_m[:-1], np.diff(self.points_m, axis=0)
        slopes = np.where(np.abs(sides) < TINY_M, TINY_M, sides)
        # Each side is in the box between the last line of the box that it enters by and the
        # first that it leaves by (Liang and Barsky 1984).
        ways = np.sort([(low_m - begins) / slopes, (high_m - begins) / slopes], axis=0)
        enters, leaves = ways[0].max(axis=1).clip(0.0, 1.0), ways[1].min(axis=1).clip(0.0, 1.0)
        lengths = np.hypot(*sides.T)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        firsts = np.floor((along[:-1] + enters * lengths) / FENCE_STEP_M)
        lasts = np.ceil((along[:-1] + leaves * lengths) / FENCE_STEP_M)
        steps = [
            np.arange(first, last + 1.0)
            for first, last, is_in in zip(firsts, lasts, enters < leaves, strict=True)
            if is_in
        ]
        at = FENCE_STEP_M * np.unique(np.concatenate([np.zeros(0), *steps]))
        return np.column_stack([np.interp(at, along, self.points_m[:, k]) for k in (0, 1)])
