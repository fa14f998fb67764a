# SPDX-License-Identifier: MIT
"""The INS of the paper, section 3, on top of SLAM, section 5: what a scan leads to.

In comes a scan with the motion since the one before; out comes the corrected pose and, for a
scan at a node, where to go next. Owns the SLAM and exploration state; runs in the daemon's one
worker thread and, step for step the same, in replay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ins_robot.config import Config
from ins_robot.estimation.placement import Misfit
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan, MotionIncrement, PoseEstimate
from ins_robot.navigation.explorer import Drive, Explorer, Finished

SOON_TOUCHED_M = 0.8  # from the LRF: what the body may touch before the next look
SAME_WALL_M = 0.025  # a reading this near to a known surface is one of it
LONE_M = 0.018  # beams are up to 14 mm apart there; a reading with none so near is a ghost

Decision = Drive | Finished
Timer = Callable[[], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sector:
    """Which part of the surroundings a scan looks at, about the base's x axis."""

    centre_rad: float = 0.0
    half_width_rad: float = math.pi


class Survey:
    """SLAM and exploration of one run.

    Parameters
    ----------
    rng : Generator
        Every random choice of the run comes from it.
    timer_s : callable
        Tells processor time for the cost figures; does not influence any result.
    """

    def __init__(self, config: Config, rng: np.random.Generator, timer_s: Timer) -> None:
        lrf = config.lrf
        base_from_lrf = Pose2(lrf.x_m, lrf.y_m, 0.0)  # the driver has applied the yaw
        self._base_from_lrf = base_from_lrf
        self._last_scan: LaserScan | None = None  # if it could be laid on the map
        self.slam = Slam(config.slam, config.map, base_from_lrf, rng, lrf.range_trusted_m)
        self.explorer = Explorer(config.exploration, config.robot, lrf)
        self.grid: OccupancyGrid = self.slam.grid
        self.slam_ms: list[float] = []
        self.ins_ms = 0.0
        self.settle_ms = 0.0
        self._timer_s = timer_s
        self._surveyed: list[int] = []  # SLAM's node behind each of the explorer's
        self._goal: Drive | None = None
        self.ended: Finished | None = None

    def place(self, scan: LaserScan, motion: MotionIncrement) -> MotionIncrement | Misfit:
        """Narrow down a motion that is hardly known; or why the scan fits nowhere.

        The goal then counts as failed: it waits, is tried once more, then given up.
        """
        placed = self.slam.place(scan, motion)
        if isinstance(placed, Misfit) and self._goal is not None:
            self.explorer.report_failure(self._goal, "the scan there fitted nowhere")
            self._goal = None
        return placed

    def scan_at_node(
        self, scan: LaserScan, motion: MotionIncrement, sector: Sector
    ) -> tuple[PoseEstimate, Decision]:
        """Correct the pose, make this place a node, decide where to go."""
        estimate = self._locate(scan, lambda: self.slam.step(scan, motion, Keep.ALWAYS))
        begun_s = self._timer_s()
        self._observe(scan, sector)
        decision = self._decide(self.slam.pose)
        self.ins_ms += 1e3 * (self._timer_s() - begun_s)
        return estimate, decision

    def scan_on_the_way(self, scan: LaserScan, motion: MotionIncrement) -> PoseEstimate:
        """Correct the pose, and draw what is new; no decision."""
        self.explorer.blindness.glimpsed(scan)
        return self._locate(scan, lambda: self.slam.step(scan, motion, Keep.APART))

    def scan_where_put_down(
        self, scan: LaserScan, pose: Pose2, covariance: FloatArray, carried_from: Pose2
    ) -> PoseEstimate:
        """Somebody carried the robot to `pose`: a node there, whole turn; no decision."""
        estimate = self._locate(scan, lambda: self.slam.relocate(scan, pose, covariance))
        self._observe(scan, Sector(), carried_from)
        self._goal = None
        return estimate

    def give_up(self, goal: Drive, why: str, pose: Pose2) -> Decision:
        """The goal could not be reached: decide again, from where the robot stands."""
        self.explorer.report_failure(goal, why)
        return self.replan(pose)

    def replan(self, pose: Pose2) -> Decision:
        """Decide again on the map as it is now, for the robot at `pose`."""
        begun_s = self._timer_s()
        self._follow_corrections()
        decision = self._decide(pose)
        self.ins_ms += 1e3 * (self._timer_s() - begun_s)
        return decision

    def send_to(self, place_m: tuple[float, float], pose: Pose2) -> Drive:
        """To a place somebody named; a StateError when no known way leads there."""
        self._follow_corrections()
        drive = self.explorer.send_to(np.array(place_m), pose, self.grid)
        self._goal, self.ended = drive, None
        return drive

    def end(self, why: str, pose: Pose2) -> Decision:
        """Explore no more: home, or finished."""
        self._follow_corrections()
        return self._note(self.explorer.end(why, pose, self.grid))

    def settle(self) -> None:
        """No more scans come: the map as all of them together tell it."""
        begun_s = self._timer_s()
        self.slam.settle()
        self.grid = self.slam.grid
        self._follow_corrections()
        self.settle_ms = 1e3 * (self._timer_s() - begun_s)

    def obstacles(self, pose: Pose2) -> cKDTree:
        """Points (N, 2) on all that a body at `pose` must not touch, fences included."""
        walls, fence_m = self.grid.walls(), self.explorer.bounds.fence_m(pose)
        more_m = np.concatenate([fence_m, self._seen_again(walls)])
        return cKDTree(np.concatenate([walls.data, more_m])) if len(more_m) else walls

    def _seen_again(self, walls: cKDTree) -> FloatArray:
        """(N, 2) what the last scan saw of known walls near by, where it saw them.

        The map may have them a centimetre off, from another node: as much as there is room.
        """
        if self._last_scan is None or walls.n == 0:
            return np.zeros((0, 2))
        scan, lrf = self._last_scan, self.slam.pose @ self._base_from_lrf
        points_m = scan.points_lrf_m()
        points_m = lrf.apply(points_m[np.hypot(*points_m.T) < SOON_TOUCHED_M])
        beside_m, _ = cKDTree(points_m).query(points_m, k=2)
        is_known = walls.query(points_m)[0] < SAME_WALL_M
        return np.asarray(points_m[is_known & (beside_m[:, 1] < LONE_M)])

    def _decide(self, pose: Pose2) -> Decision:
        return self._note(self.explorer.decide(pose, self.grid))

    def _note(self, decision: Decision) -> Decision:
        self._goal = decision if isinstance(decision, Drive) else None
        self.ended = decision if isinstance(decision, Finished) else None
        return decision

    def _observe(
        self, scan: LaserScan, sector: Sector, carried_from: Pose2 | None = None
    ) -> None:
        """SLAM's newest node is the explorer's too."""
        node = self.slam.nodes[-1]
        self._follow_corrections()
        self._surveyed.append(node.id)
        looked = (sector.centre_rad, sector.half_width_rad)
        self.explorer.observe(node.id, node.stamp_s, node.pose, scan, looked, carried_from)

    def _locate(self, scan: LaserScan, step: Callable[[], PoseEstimate]) -> PoseEstimate:
        begun_s = self._timer_s()
        estimate = step()
        self._last_scan = scan if self.slam.is_located else None
        # Drawn now, once a step: when it is asked for later must not change the map.
        self.grid = self.slam.grid
        self.slam_ms.append(1e3 * (self._timer_s() - begun_s))
        return estimate

    def _follow_corrections(self) -> None:
        """Nodes that SLAM moved carry their gaps with them."""
        nodes = self.slam.nodes
        poses = [nodes[node_id].pose.as_array() for node_id in self._surveyed]
        self.explorer.relocate(np.array(poses).reshape(-1, 3))
