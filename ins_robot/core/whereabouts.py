# SPDX-License-Identifier: MIT
"""Where a robot is that has been paused: somebody may have carried it meanwhile.

Looks from standing and the map in; out comes, after each, that the robot is where the odometry
has it, or where else it was put down, or why that is not known yet. It is looked for there,
then around there as for a nudge, which counts if nothing else looks like it, then everywhere.
Nothing is changed here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ins_robot.estimation.global_localization import (
    BEAMS_MIN,
    Ambiguous,
    GlobalLocalizer,
    Located,
    Lost,
    Verdict,
)
from ins_robot.estimation.map_fit import Beams
from ins_robot.estimation.slam import Slam
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan, MotionIncrement

# Further looks from one place repeat the errors of map and scan, not only what is right.
LOOKS_MAX = 3
SAME_PLACE_M = 0.5


def _covariance(std_m: float, std_deg: float) -> FloatArray:
    return np.diag([std_m**2, std_m**2, math.radians(std_deg) ** 2])


TOUCHED = _covariance(0.03, 2.0)  # what wheels may turn in a pause, unnoticed
NUDGED = _covariance(0.3, 15.0)
LOCATED = _covariance(0.1, 4.0)  # more than the localizer says of itself: it is to be checked
STOOD = _covariance(0.005, 0.3)  # between two looks


@dataclass(frozen=True, slots=True, kw_only=True)
class Here:
    """Where the odometry has it; `motion` is that since the last scan, as sure as it is now."""

    motion: MotionIncrement

    def __str__(self) -> str:
        return "where it was paused, or a step beside it"


@dataclass(frozen=True, slots=True, kw_only=True)
class PutDown:
    """Somewhere else: map_from_base and its covariance (3, 3)."""

    pose: Pose2
    covariance: FloatArray

    def __str__(self) -> str:
        at = self.pose
        degrees = math.degrees(at.heading_rad)
        return f"put down at x {at.x_m:.2f} m, y {at.y_m:.2f} m, heading {degrees:.0f} deg"


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Not known from what has been seen so far."""

    why: str

    def __str__(self) -> str:
        return self.why

    def advice(self, pose: Pose2) -> str:
        """One sentence: why, and what to do; the robot was paused at `pose`."""
        return (
            f"{self.why}; put the robot back near x {pose.x_m:.1f} m, y {pose.y_m:.1f} m, "
            "where it was paused, or where more of the map shows, then `ins-robot resume`"
        )


Found = Here | PutDown | Unknown


class Whereabouts:
    """The looks from one place after one pause."""

    def __init__(self, slam: Slam, base_from_lrf: Pose2) -> None:
        self._slam = slam
        self._base_from_lrf = base_from_lrf
        self._localizer: GlobalLocalizer | None = None

    def look(self, scan: LaserScan, motion: MotionIncrement, grid: OccupancyGrid) -> Found:
        """One more; `motion` is that since the last scan of the map."""
        motion = replace(motion, covariance=motion.covariance + TOUCHED / motion.repeated)
        if self._slam.fits(scan, motion):
            return Here(motion=motion)
        if len(Beams.of(scan, self._base_from_lrf)) < BEAMS_MIN:
            return Unknown(why="the LRF sees next to nothing here (is it covered?)")
        nudged = self._put_down(scan, self._slam.pose @ motion.delta, NUDGED)
        verdict = self._anywhere(scan, grid)
        if nudged is not None and _has_no_rival(nudged.pose, verdict):
            return nudged
        found = None
        if isinstance(verdict, Located):
            found = self._put_down(scan, verdict.pose, verdict.covariance + LOCATED)
        return found or Unknown(why=_why(verdict))

    def _anywhere(self, scan: LaserScan, grid: OccupancyGrid) -> Verdict:
        if self._localizer is None:
            self._localizer = GlobalLocalizer(grid, self._base_from_lrf)
        stood = MotionIncrement(
            from_stamp_s=scan.stamp_s,
            to_stamp_s=scan.stamp_s,
            delta=Pose2(),
            covariance=STOOD,
        )
        return self._localizer.step(scan, stood)

    def _put_down(self, scan: LaserScan, pose: Pose2, doubt: FloatArray) -> PutDown | None:
        placed = self._slam.place_at(scan, pose, doubt)
        return None if placed is None else PutDown(pose=placed[0], covariance=placed[1])


def _has_no_rival(pose: Pose2, verdict: Verdict) -> bool:
    """Whether nowhere else on the map looks like it: it need not have been a nudge."""
    match verdict:
        case Lost():
            return True
        case Located():
            return verdict.pose.distance_m(pose) < SAME_PLACE_M
        case Ambiguous():
            off_m = np.hypot(*(verdict.poses[:, :2] - (pose.x_m, pose.y_m)).T)
            return bool((off_m < SAME_PLACE_M).all())


def _why(verdict: Verdict) -> str:
    fit = f"{verdict.fit_share:.0%}"
    match verdict:
        case Lost():
            return f"what the LRF sees is nowhere on the map (at best {fit} of it)"
        case Ambiguous() if len(verdict.poses) > 1:
            return f"{len(verdict.poses)} places of the map look like what the LRF sees"
    return f"what the LRF sees fits no place of the map for certain (the best by {fit})"
