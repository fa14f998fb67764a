# SPDX-License-Identifier: MIT
"""The Intelligent Navigation System of the paper, its section 3, step by step.

After each node scan: gaps are told from walls (step 02), neighbours identified (step 03, rules
A, B, C), the travel-cost map taken from the current node, the cheapest node with an unexplored
gap chosen and in it the narrowest (or as the strategy says), and the way planned (step 04).
Scan, pose and map in; `Drive` or `Finished` out. Pure: same calls, same answers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ins_robot.config import ExplorationConfig, LrfConfig, RobotConfig
from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.messages import LaserScan, PlannedPath
from ins_robot.navigation.gaps import Gap, GapKind, GapRules, GapState, find_gaps
from ins_robot.navigation.guard import Guard, NoGuard, SeenGuard, edges_of_gap, within_radius
from ins_robot.navigation.neighbours import identify_neighbours
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.planner import dense_points_m, plan_through
from ins_robot.navigation.squeeze import find_squeezes
from ins_robot.navigation.strategies import Candidate, Situation, make_strategy
from ins_robot.navigation.terrain import BodyRules, Terrain, driven_cells, survey_terrain
from ins_robot.navigation.unseen import SIGHT_M, BarrenEdges, Unseen, survey_unseen
from ins_robot.navigation.viewpoint import Look, Viewpoint, near_viewpoint, peeks

MOVED_SHARE = 0.5  # a scan that leaves more than this share of its edges was in vain
GAIN_MIN_M2 = 0.15  # a scan that can show less adds nothing
SAME_PLACE_M = 0.12  # a scan this near to an earlier one shows the same
MOVED_M = 0.02  # a node corrected by more: the map is looked at again everywhere
DRIVEN_STEP_M = 0.04  # spacing of the memory of driven ways
FAILURES_MAX = 2  # a goal refused this often is given up


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Drive along the path, then scan there."""

    path: PlannedPath
    node_id: int
    gap_id: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftGap:
    """A gap that was left, and why."""

    node_id: int
    gap_id: int
    centroid_m: tuple[float, float]
    width_m: float
    state: str
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """Nothing left to drive to; `is_complete` is False when a limit ended it."""

    reason: str
    left: tuple[LeftGap, ...]
    is_complete: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aim:
    """What the last drive was for."""

    drive: Drive
    node: Node
    gap: Gap
    targets_m: FloatArray
    is_retraced: bool  # over the nodes of the way back


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """What showed from a gap when the newest node was `at_node`."""

    at_node: int
    targets_m: FloatArray


@dataclass(slots=True, kw_only=True)
class _Scene:
    """One decision's view of the world; `targets` holds the gaps worth driving to."""

    pose: Pose2
    grid: OccupancyGrid
    terrain: Terrain
    unseen: Unseen
    targets: dict[int, FloatArray] = field(default_factory=dict)
    has_adopted: bool = False
    has_squeezed: bool = False


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
        self._sector_half_rad = float(np.radians(lrf.sector_deg))
        self._range_m = lrf.range_max_m
        self._strategy = make_strategy(config.strategy)
        self._guard: Guard = SeenGuard() if config.visibility_guard else NoGuard()
        self._barren = BarrenEdges()
        self._aim: _Aim | None = None
        self._scanned_aim: _Aim | None = None
        self._refused_m: list[FloatArray] = []
        self._failed: Drive | None = None
        self._driven_m: list[FloatArray] = []  # ways since the last node
        self._shown: dict[tuple[int, int], _Shown] = {}
        self._is_new_node = False

    # Steps 01 and 02: a node here; gaps and walls told apart.

    def observe(
        self,
        node_id: int,
        stamp_s: float,
        pose: Pose2,
        scan: LaserScan,
        sector: tuple[float, float],
    ) -> None:
        """A scan was taken at `pose` (map_from_base) of `sector` (centre, half width)."""
        before = self.graph.nodes[-1] if self.graph.nodes else None
        node = Node(
            index=len(self.graph),
            id=node_id,
            stamp_s=stamp_s,
            pose=pose,
            sector=sector,
            bearings_rad=scan.bearings_rad,
            ranges_m=scan.ranges_m,
            gaps=find_gaps(scan, self._base_from_lrf, sector, self._rules),
            came_from=None if before is None else before.index,
        )
        if self._aim is not None and before is not None:
            self._note_driven(self._aim.drive, node.position_m)
            self._remember_way(node, self._aim)
            if self._aim.gap.is_open:
                self._aim.gap.set(GapState.EXPLORED, f"scanned at its place: node {node_id}")
        self._driven_m.clear()
        self.graph.add(node)
        self._scanned_aim, self._aim = self._aim, None
        self._is_new_node = True

    def relocate(self, poses: FloatArray) -> None:
        """SLAM moved the nodes: poses (K, 3) of all K of them, in order of observation."""
        if len(poses) != len(self.graph):
            raise StateError(
                f"relocate: {len(poses)} poses for {len(self.graph)} observed nodes"
            )
        for node, pose in zip(self.graph.nodes, poses, strict=True):
            moved = Pose2.from_array(pose)
            if moved.distance_m(node.pose) > MOVED_M:
                self._shown.clear()  # the map has moved as well
            node.pose = moved

    # Steps 03 and 04: where next, and how.

    def decide(self, pose: Pose2, grid: OccupancyGrid) -> Drive | Finished:
        """Where to go from `pose` (map_from_base), given the map so far."""
        if not self.graph.nodes:
            raise StateError("explorer: decide() before the first scan; call observe() first")
        if len(self.graph) >= self._config.max_scans:
            return self._finished(f"max_scans = {self._config.max_scans} reached", False, None)
        if self._failed is not None:
            self._note_driven(self._failed, np.array([pose.x_m, pose.y_m]))
            self._failed = None
        scene = self._look_around(pose, grid)
        self._learn_from_last_scan(scene)
        self._identify_neighbours(scene)
        self._sort_gaps(scene)
        while (choice := self._choose(scene)) is not None:
            drive = self._drive_to(scene, pose, *choice)
            if drive is not None:
                return drive
        return self._finished("no reachable gap is left", True, scene)

    def report_failure(self, decision: Drive, why: str) -> None:
        """The goal could not be reached: it waits, is tried once more, then given up."""
        aim, self._aim = self._aim, None
        if aim is None or aim.drive is not decision:
            raise StateError("explorer: report_failure() of what is not the last decision")
        self._failed = decision
        self._refused_m.append(decision.path.points_m[-1])
        self._barren.strike(aim.targets_m)
        aim.gap.failures += 1
        aim.gap.is_deferred = True
        if aim.gap.failures >= FAILURES_MAX:
            aim.gap.set(GapState.UNREACHABLE, f"given up after {aim.gap.failures} tries: {why}")

    def as_json(self) -> dict[str, Any]:
        """`nodes` with their `gaps`, for graph.json."""
        return self.graph.as_json()

    # The steps, one by one.

    def _note_driven(self, drive: Drive, until_m: FloatArray) -> None:
        """Remember a path as driven, up to its place nearest to where the robot is now."""
        points = dense_points_m(drive.path.points_m, DRIVEN_STEP_M)
        away = points - until_m
        nearest = int(np.hypot(away[:, 0], away[:, 1]).argmin())
        self._driven_m.append(points[: nearest + 1])

    def _remember_way(self, node: Node, aim: _Aim) -> None:
        """From which node the robot came, and how; a way retraced counts from where it ends."""
        way_m = np.concatenate(self._driven_m)
        if aim.is_retraced:
            away_m = way_m - aim.node.position_m
            nearest = len(way_m) - 1 - int(np.hypot(*away_m[::-1].T).argmin())
            node.came_from, way_m = aim.node.index, way_m[nearest:]
        if node.came_from is not None:
            origin = self.graph.nodes[node.came_from].pose
            node.came_by_m = origin.inverse().apply(way_m)

    def _look_around(self, pose: Pose2, grid: OccupancyGrid) -> _Scene:
        """What is unseen, where the robot can go, and what it costs: one wave."""
        is_allowed = self._allowed(grid)
        unseen = survey_unseen(grid, self._config.frontier_min_m, self._barren, is_allowed)
        been_m = np.concatenate([self.graph.driven_m(), *self._driven_m])
        odd = driven_cells(grid, been_m, self._body)
        terrain = survey_terrain(grid, pose, self._body, is_allowed, odd)
        return _Scene(pose=pose, grid=grid, terrain=terrain, unseen=unseen)

    def _squeeze(self, scene: _Scene) -> bool:
        """Look at the ground again, narrow passages included; once a decision."""
        if scene.has_squeezed:
            return False
        scene.has_squeezed = True
        grid, unseen = scene.grid, scene.unseen
        odd = find_squeezes(grid, self.graph, self._body, unseen.is_unseen)
        before = scene.terrain.is_reachable.sum()
        scene.terrain = survey_terrain(
            grid,
            scene.pose,
            self._body,
            self._allowed(grid),
            scene.terrain.odd.joined(odd),
        )
        if scene.terrain.is_reachable.sum() <= before:
            return False
        self._sort_gaps(scene)
        scene.has_adopted = False
        return True

    def _allowed(self, grid: OccupancyGrid) -> np.ndarray | None:
        """(H, W) bool: within `exploration.max_radius_m` of the start."""
        radius_m = self._config.max_radius_m
        if radius_m <= 0.0:
            return None
        height, width = grid.shape
        cells = np.argwhere(np.ones((height, width), bool))
        start = self.graph.nodes[0].pose
        return within_radius(start, radius_m, grid.metres(cells)).reshape(height, width)

    def _learn_from_last_scan(self, scene: _Scene) -> None:
        """Edges that a scan aimed at them did not move count as tried."""
        aim, self._scanned_aim = self._scanned_aim, None
        if aim is None:
            return
        cells = scene.grid.cells(aim.targets_m)
        still = ~scene.grid.contains(cells)
        still[~still] = scene.unseen.is_unseen[cells[~still, 0], cells[~still, 1]]
        if still.mean() > MOVED_SHARE:
            self._barren.strike(aim.targets_m[still])

    def _identify_neighbours(self, scene: _Scene) -> None:
        """Rules A, B and C between the newest node and all others."""
        if not self._is_new_node:
            return
        self._is_new_node = False
        identify_neighbours(
            self.graph,
            self.graph.nodes[-1],
            neighbour_range_m=self._config.neighbour_range_m,
            robot_width_m=self._rules.robot_width_m,
            terrain=scene.terrain,
            is_seen=(lambda node, gap: len(self._targets(scene, node, gap)) == 0)
            if self._config.visibility_guard
            else None,
        )

    def _targets(self, scene: _Scene, node: Node, gap: Gap) -> FloatArray:
        """What a scan at the gap should show; asked again only where the last scan reached."""
        key = (node.index, gap.id)
        known = self._shown.get(key)
        if known is not None and known.at_node < len(self.graph) - 1:
            away_m = node.centroid_m(gap) - self.graph.nodes[-1].position_m
            if math.hypot(*away_m) <= self._range_m + SIGHT_M + gap.width_m:
                known = None
        if known is None:
            targets = self._guard.targets_m(scene.unseen, self.graph, node, gap)
        else:
            targets = known.targets_m[~self._barren.mask(known.targets_m)]
        self._shown[key] = _Shown(at_node=len(self.graph) - 1, targets_m=targets)
        return targets

    def _sort_gaps(self, scene: _Scene) -> None:
        """Look at every gap again; what was out of reach may have come into it."""
        for _, gap in self.graph.gaps():
            if gap.state is GapState.UNREACHABLE and gap.failures < FAILURES_MAX:
                gap.set(GapState.UNEXPLORED, "")
        self._close_explored(scene)

    def _close_explored(self, scene: _Scene) -> None:
        """Close the gaps the guard calls explored; note what the others should show."""
        radius_m, start = self._config.max_radius_m, self.graph.nodes[0].pose
        for node, gap in self.graph.gaps():
            if gap.state not in (GapState.UNEXPLORED, GapState.TOO_NARROW):
                continue
            if not within_radius(start, radius_m, node.centroid_m(gap)[None])[0]:
                gap.set(GapState.UNREACHABLE, f"outside max_radius_m = {radius_m:g}")
                continue
            targets = self._targets(scene, node, gap)
            if len(targets) == 0:
                gap.set(GapState.EXPLORED, "nothing unseen shows from it")
            elif gap.is_open:
                scene.targets[id(gap)] = targets

    def _choose(self, scene: _Scene) -> Candidate | None:
        """The strategy's gap; edges of the map once none is left; at last what was refused."""
        candidates = self._candidates(scene)
        if not candidates and self._adopt_edges(scene):
            candidates = self._candidates(scene)
        if not candidates and self._squeeze(scene):
            return self._choose(scene)
        if not candidates:
            for _, gap in self.graph.gaps():
                gap.is_deferred = False
            candidates = self._candidates(scene)
        current = self.graph.nodes[-1].index
        return self._strategy.choose(
            Situation(
                graph=self.graph,
                current=current,
                costs_m=self.graph.costs_from(current),
                candidates=candidates,
            )
        )

    def _candidates(self, scene: _Scene) -> list[Candidate]:
        return [
            (node, gap)
            for node, gap in self.graph.gaps()
            if gap.is_open and not gap.is_deferred and id(gap) in scene.targets
        ]

    def _adopt_edges(self, scene: _Scene) -> bool:
        """Edges of the seen part that no gap leads to become gaps of the nearest node.

        Once a decision: an edge refused in this decision does not come back in it.
        """
        if scene.has_adopted:
            return False
        scene.has_adopted = True
        led_to: set[int] = set()
        for node, gap in self.graph.gaps():
            is_known_edge = gap.kind is GapKind.EDGE and gap.state is GapState.UNREACHABLE
            if gap.is_open or is_known_edge:
                index = edges_of_gap(scene.unseen, node, gap)
                led_to.update(scene.unseen.edge_of[index].tolist())
        if not self._guard.adopt_edges(scene.unseen, self.graph, led_to):
            return False
        self._close_explored(scene)
        return True

    def _drive_to(self, scene: _Scene, pose: Pose2, node: Node, gap: Gap) -> Drive | None:
        """The way to the gap's viewpoint; None, and the gap says why, when there is none."""
        view = self._viewpoint(scene, node, gap)
        if view is None:
            return None
        via = [self.graph.nodes[i] for i in self._strategy.retraces(self.graph, node)]
        path = plan_through(scene.terrain, pose, via, view.cell, view.heading_rad)
        drive = Drive(
            path=path,
            node_id=node.id,
            gap_id=gap.id,
            reason=f"{self._strategy.name}: {gap.kind} {gap.id} of node {node.id}, "
            f"{gap.width_m:.2f} m wide, {path.length_m:.1f} m to drive",
        )
        self._aim = _Aim(
            drive=drive,
            node=node,
            gap=gap,
            targets_m=scene.targets[id(gap)],
            is_retraced=len(via) > 1,
        )
        return drive

    def _viewpoint(self, scene: _Scene, node: Node, gap: Gap) -> Viewpoint | None:
        """A place from which a scan shows something new; None, and the gap says why."""
        look = Look(
            centroid_m=node.centroid_m(gap),
            outward=node.outward(gap),
            targets_m=scene.targets[id(gap)],
            used_m=np.array([*self.graph.positions_m(), *self._refused_m]),
        )
        view = near_viewpoint(scene.terrain, scene.unseen.is_opaque, look)
        if view is not None and self._is_worth(scene, view, look):
            return view
        if gap.kind is GapKind.EDGE:
            opaque = scene.unseen.is_opaque
            for peek in peeks(scene.terrain, opaque, look, lambda p: self._gain(scene, p)):
                view = peek
                if self._is_worth(scene, view, look):
                    return view
        if view is None:
            gap.set(GapState.UNREACHABLE, "no reachable place looks into it")
            return None
        if gap.kind is GapKind.EDGE:
            self._barren.strike(look.targets_m, FAILURES_MAX)
        gap.set(GapState.EXPLORED, "adds nothing: a scan there would show no more")
        return None

    def _is_worth(self, scene: _Scene, view: Viewpoint, look: Look) -> bool:
        """Whether a scan there may show something that no earlier one did."""
        if not self._config.visibility_guard:
            return True
        if self._scanned_from(scene, view, look.targets_m) is not None:
            return False
        return self._gain(scene, view) * scene.grid.resolution_m**2 >= GAIN_MIN_M2

    def _gain(self, scene: _Scene, view: Viewpoint) -> int:
        """Unseen cells that a scan may show."""
        half_rad, range_m = self._sector_half_rad, self._range_m
        return scene.unseen.gain_cells(view.cell, view.heading_rad, half_rad, range_m)

    def _scanned_from(
        self, scene: _Scene, view: Viewpoint, targets_m: FloatArray
    ) -> Node | None:
        """The node that has looked at the targets from the same place."""
        place = scene.grid.metres(np.array(view.cell))
        away = self.graph.positions_m() - place
        for index in np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) < SAME_PLACE_M):
            node = self.graph.nodes[int(index)]
            ahead = targets_m - node.position_m
            bearings = np.arctan2(ahead[:, 1], ahead[:, 0]) - node.pose.heading_rad
            centre_rad, half_rad = node.sector
            if (np.abs(wrap_rad(bearings - centre_rad)) < half_rad).mean() > MOVED_SHARE:
                return node
        return None

    def _finished(self, reason: str, is_complete: bool, scene: _Scene | None) -> Finished:
        left = tuple(
            LeftGap(
                node_id=node.id,
                gap_id=gap.id,
                centroid_m=(float(node.centroid_m(gap)[0]), float(node.centroid_m(gap)[1])),
                width_m=gap.width_m,
                state=str(gap.state),
                why=gap.why,
            )
            for node, gap in self.graph.gaps()
            if gap.state is not GapState.EXPLORED
        )
        return Finished(reason=reason, left=left, is_complete=is_complete)
