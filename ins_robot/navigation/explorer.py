# SPDX-License-Identifier: MIT
"""The Intelligent Navigation System of the paper, its section 3, step by step.

After each node scan: gaps are told from walls (step 02), neighbours identified (step 03, rules
A, B, C), the travel-cost map taken from the current node, the cheapest node with an unexplored
gap chosen and in it the narrowest (or as the strategy says), and the way planned (step 04).
Scan, pose and map in; `Drive` or `Finished` out. Pure: same calls, same answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ins_robot.config import ExplorationConfig, LrfConfig, RobotConfig
from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan
from ins_robot.navigation.decisions import Drive, Finished, LeftGap, left_gaps
from ins_robot.navigation.driven_ways import DrivenWays
from ins_robot.navigation.gap_ledger import FAILURES_MAX, GapLedger
from ins_robot.navigation.gaps import Gap, GapRules, GapState, find_gaps
from ins_robot.navigation.guard import Guard, NoGuard, SeenGuard
from ins_robot.navigation.neighbours import identify_neighbours
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.planner import plan_through
from ins_robot.navigation.scan_place import ScanPlaces
from ins_robot.navigation.scene import Bounds, Scene, look_around
from ins_robot.navigation.strategies import Candidate, Situation, make_strategy
from ins_robot.navigation.terrain import BodyRules
from ins_robot.navigation.unseen import BarrenEdges

__all__ = ["Drive", "Explorer", "Finished", "LeftGap"]

IN_VAIN_SHARE = 0.5  # a scan that leaves more of what it was to show unseen was in vain
MOVED_M = 0.02  # a node corrected by more: the map is looked at again everywhere


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aim:
    """What the last drive is for."""

    drive: Drive
    node: Node
    gap: Gap
    targets_m: FloatArray
    is_retraced: bool  # over the nodes of the way back


class Explorer:
    """Nodes, gaps and decisions of one run."""

    def __init__(self, config: ExplorationConfig, robot: RobotConfig, lrf: LrfConfig) -> None:
        self.graph = NodeGraph()
        self._config = config
        self._base_from_lrf = Pose2(lrf.x_m, lrf.y_m, 0.0)  # the driver has applied the yaw
        self._body = BodyRules(radius_m=robot.radius_m, clearance_m=config.clearance_m)
        self._rules = GapRules(
            gap_range_m=config.gap_range_m,
            gap_jump_m=config.gap_jump_m,
            range_trusted_m=lrf.range_trusted_m,
            robot_width_m=2.0 * robot.radius_m,
        )
        self._bounds = Bounds(radius_m=config.max_radius_m)
        self._strategy = make_strategy(config.strategy)
        guard: Guard = SeenGuard() if config.visibility_guard else NoGuard()
        self._barren = BarrenEdges()
        self._ledger = GapLedger(self.graph, guard, self._barren, self._bounds, lrf.range_max_m)
        self._places = ScanPlaces(
            self.graph,
            self._barren,
            sector_half_rad=float(np.radians(lrf.sector_deg)),
            range_m=lrf.range_max_m,
            must_gain=config.visibility_guard,
        )
        self._ways = DrivenWays(self.graph)
        self._aim: _Aim | None = None
        self._scanned_aim: _Aim | None = None
        self._has_new_node = False

    def observe(
        self,
        node_id: int,
        stamp_s: float,
        pose: Pose2,
        scan: LaserScan,
        sector: tuple[float, float],
    ) -> None:
        """Steps 01 and 02: a node here; gaps and walls told apart in its scan.

        Parameters
        ----------
        pose : Pose2
            map_from_base when the scan was taken.
        sector : (centre_rad, half_width_rad)
            What the scan looked at, about the base's x axis.
        """
        node = Node(
            index=len(self.graph),
            id=node_id,
            stamp_s=stamp_s,
            pose=pose,
            sector=sector,
            bearings_rad=scan.bearings_rad,
            ranges_m=scan.ranges_m,
            gaps=find_gaps(scan, self._base_from_lrf, sector, self._rules),
            came_from=len(self.graph) - 1 if self.graph.nodes else None,
        )
        if self._aim is not None:
            self._arrive(node, self._aim)
        self.graph.add(node)
        self._scanned_aim, self._aim = self._aim, None
        self._has_new_node = True

    def relocate(self, poses: FloatArray) -> None:
        """SLAM moved the nodes: poses (K, 3) of all K of them, in order of observation."""
        if len(poses) != len(self.graph):
            raise StateError(
                f"relocate: {len(poses)} poses for {len(self.graph)} observed nodes"
            )
        for node, pose in zip(self.graph.nodes, poses, strict=True):
            moved = Pose2.from_array(pose)
            if moved.distance_m(node.pose) > MOVED_M:
                self._ledger.forget()
            node.pose = moved

    def decide(self, pose: Pose2, grid: OccupancyGrid) -> Drive | Finished:
        """Steps 03 and 04: where next from `pose` (map_from_base), and how."""
        if not self.graph.nodes:
            raise StateError("explorer: decide() before the first scan; call observe() first")
        if len(self.graph) >= self._config.max_scans:
            reason = f"max_scans = {self._config.max_scans} reached"
            return Finished(reason=reason, left=left_gaps(self.graph), is_complete=False)
        self._ways.stands_at(pose)
        scene = self._look_around(pose, grid)
        self._learn_from_last_scan(scene)
        self._identify_neighbours(scene)
        self._ledger.update(scene)
        costs_m = self.graph.costs_from(len(self.graph) - 1)
        while (choice := self._choose(scene, costs_m)) is not None:
            drive = self._drive_to(scene, *choice)
            if drive is not None:
                return drive
        return Finished(reason="no reachable gap is left", left=left_gaps(self.graph))

    def report_failure(self, decision: Drive, why: str) -> None:
        """The goal could not be reached: it waits, is tried once more, then given up."""
        aim, self._aim = self._aim, None
        if aim is None or aim.drive is not decision:
            raise StateError("explorer: report_failure() of what is not the last decision")
        self._ways.gave_up(decision.path.points_m)
        self._places.refuse(decision.path.points_m[-1])
        self._barren.strike(aim.targets_m)
        aim.gap.failures += 1
        aim.gap.is_deferred = True
        if aim.gap.failures >= FAILURES_MAX:
            aim.gap.set(GapState.UNREACHABLE, f"given up after {aim.gap.failures} tries: {why}")

    def as_json(self) -> dict[str, Any]:
        """`nodes` with their `gaps`, for graph.json."""
        return self.graph.as_json()

    def _arrive(self, node: Node, aim: _Aim) -> None:
        """The drive has ended in a new node, and its gap has been looked into."""
        self._ways.arrived(node, aim.drive.path.points_m, aim.node if aim.is_retraced else None)
        if aim.gap.is_open:
            aim.gap.set(GapState.EXPLORED, f"scanned at its place: node {node.id}")

    def _look_around(self, pose: Pose2, grid: OccupancyGrid) -> Scene:
        return look_around(
            grid,
            pose,
            self._body,
            is_allowed=self._bounds.cells(self.graph.nodes[0].pose, grid),
            edge_min_m=self._config.frontier_min_m,
            barren=self._barren,
            driven_m=self._ways.places_m(),
        )

    def _learn_from_last_scan(self, scene: Scene) -> None:
        """What a scan was to show and did not counts as tried: nothing is scanned for ever."""
        aim, self._scanned_aim = self._scanned_aim, None
        if aim is None:
            return
        cells = scene.grid.cells(aim.targets_m)
        still = ~scene.grid.contains(cells)
        still[~still] = scene.unseen.is_unseen[cells[~still, 0], cells[~still, 1]]
        if still.mean() > IN_VAIN_SHARE:
            self._barren.strike(aim.targets_m[still])

    def _identify_neighbours(self, scene: Scene) -> None:
        """Rules A, B and C between the newest node and all others, once a node."""
        if not self._has_new_node:
            return
        self._has_new_node = False
        is_seen = None
        if self._config.visibility_guard:
            is_seen = partial(self._ledger.is_seen, scene)
        identify_neighbours(
            self.graph,
            self.graph.nodes[-1],
            neighbour_range_m=self._config.neighbour_range_m,
            robot_width_m=self._rules.robot_width_m,
            terrain=scene.terrain,
            is_seen=is_seen,
        )

    def _choose(self, scene: Scene, costs_m: FloatArray) -> Candidate | None:
        """The strategy's gap, given what it costs to get to each node."""
        return self._strategy.choose(
            Situation(
                graph=self.graph,
                current=len(self.graph) - 1,
                candidates=self._ledger.candidates(scene),
                costs_m=costs_m,
            )
        )

    def _drive_to(self, scene: Scene, node: Node, gap: Gap) -> Drive | None:
        """The way to the gap; None, and the gap says why, when there is none."""
        view = self._places.choose(scene, node, gap)
        if view is None:
            return None
        via = [self.graph.nodes[index] for index in self._strategy.retraces(self.graph, node)]
        path = plan_through(scene.terrain, scene.pose, via, view.cell, view.heading_rad)
        reason = (
            f"{self._strategy.name}: {gap.kind} {gap.id} of node {node.id}, "
            f"{gap.width_m:.2f} m wide, {path.length_m:.1f} m to drive"
        )
        drive = Drive(path=path, node_id=node.id, gap_id=gap.id, reason=reason)
        self._aim = _Aim(
            drive=drive,
            node=node,
            gap=gap,
            targets_m=scene.targets[node.index, gap.id],
            is_retraced=len(via) > 1,
        )
        return drive
