# SPDX-License-Identifier: MIT
"""The Intelligent Navigation System of the paper, its section 3, step by step.

After each node scan: gaps are told from walls (step 02), neighbours identified (step 03, rules
A, B, C), the travel-cost map taken from the current node, the cheapest node with an unexplored
gap chosen and in it the narrowest (or as the strategy says), and the way planned (step 04).
Scan, pose and map in; `Drive` or `Finished` out. Pure: same calls, same answers.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from ins_robot.config import ExplorationConfig, LrfConfig, RobotConfig
from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.zones import Zone
from ins_robot.messages import LaserScan, PlannedPath
from ins_robot.navigation.aim_gap import AimGap, gap_of_aim
from ins_robot.navigation.blindness import Blindness
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.decisions import NO_GAP, Drive, Ending, Finished, LeftGap, finished
from ins_robot.navigation.driven_ways import DrivenWays
from ins_robot.navigation.errand import Errand
from ins_robot.navigation.gap_ledger import FAILURES_MAX, GapLedger
from ins_robot.navigation.gaps import Gap, GapRules, GapState, find_gaps
from ins_robot.navigation.guard import Guard, NoGuard, SeenGuard
from ins_robot.navigation.neighbours import identify_neighbours
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.outlook import Aim
from ins_robot.navigation.planner import plan, plan_through
from ins_robot.navigation.progress import Progress
from ins_robot.navigation.pursuit import Pursuit, Target
from ins_robot.navigation.reach import Reach
from ins_robot.navigation.scan_place import ScanPlaces
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.strategies import Candidate, Situation, make_strategy
from ins_robot.navigation.terrain import BodyRules
from ins_robot.navigation.trips import trip, way_home_m
from ins_robot.navigation.unseen import STRIKES, BarrenEdges
from ins_robot.navigation.way_home import WayHome

__all__ = ["Drive", "Explorer", "Finished", "LeftGap"]

FENCE_MARGIN_M = 0.03  # off forbidden lines: corners of cells, and what the guard keeps
MOVED_M = 0.02  # a node corrected by more: the map is looked at again everywhere


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
        keep_m = max(self._body.keep_m, robot.radius_m + FENCE_MARGIN_M)
        self.bounds = Bounds(config, keep_m)
        self._range_m = lrf.range_max_m
        self._looks_on_the_way = lrf.power == "continuous"
        self._sector_half_rad = float(np.radians(lrf.sector_deg))
        self._strategy = make_strategy(config.strategy)
        guard: Guard = SeenGuard() if config.visibility_guard else NoGuard()
        self._barren = BarrenEdges()
        self._vain = BarrenEdges()
        self._ledger = GapLedger(self.graph, guard, self.bounds, lrf.range_max_m)
        self._places = ScanPlaces(
            self.graph,
            sector_half_rad=self._sector_half_rad,
            range_m=lrf.range_max_m,
            must_gain=config.visibility_guard,
        )
        self._ways = DrivenWays(self.graph)
        self._pursuit = Pursuit(self.graph, self._places, self._ways, self._barren, self._vain)
        self._has_new_node = False
        self.blindness = Blindness(lrf.range_trusted_m)
        self._aimed: list[AimGap] = []  # by a strategy that chooses places, in order
        self._progress = Progress()
        self._errand: Errand | None = None
        self._home = WayHome(self.graph, self.bounds, is_wanted=config.return_home)

    def observe(
        self,
        node_id: int,
        stamp_s: float,
        pose: Pose2,
        scan: LaserScan,
        sector: tuple[float, float],
        carried_from: Pose2 | None = None,
    ) -> None:
        """Steps 01 and 02: a node here; gaps and walls told apart in its scan.

        Parameters
        ----------
        pose : Pose2
            map_from_base when the scan was taken.
        sector : (centre_rad, half_width_rad)
            What the scan looked at, about the base's x axis.
        carried_from : Pose2 or None
            From where somebody carried the robot to this node; None: it drove.
        """
        came_from = len(self.graph) - 1 if self.graph.nodes else None
        if carried_from is not None:
            self._pursuit.interrupted(carried_from)
            away_m = self.graph.positions_m() - (pose.x_m, pose.y_m)
            came_from = int(np.hypot(*away_m.T).argmin())
        node = Node(
            index=len(self.graph),
            id=node_id,
            stamp_s=stamp_s,
            pose=pose,
            sector=sector,
            bearings_rad=scan.bearings_rad,
            ranges_m=scan.ranges_m,
            gaps=find_gaps(scan, self._base_from_lrf, sector, self._rules),
            came_from=came_from,
            home_m=math.inf if self.graph.nodes else 0.0,
        )
        self._pursuit.arrived(node)
        self._errand = None
        self.graph.add(node)
        self._has_new_node = True
        self.blindness.scanned(scan)

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
            self.graph.move(node.index, moved)

    def decide(self, pose: Pose2, grid: OccupancyGrid) -> Drive | Finished:
        """Steps 03 and 04: where next from `pose` (map_from_base), and how."""
        if not self.graph.nodes:
            raise StateError("explorer: decide() before the first scan; call observe() first")
        scene = self._stand_and_look(pose, grid)
        if self.blindness.is_sure(pose, grid):
            return self._stay(scene)
        if self._errand is not None:
            path = self._errand.path(scene)
            if path is not None:
                return self._set_out(scene, path, "goto")
            self._errand = None  # the map has closed the way meanwhile
        if self._home.ending is not None and not self._home.looks_again(pose):
            return self._end(scene, self._home.ending)
        return self._explore_on(scene)

    def send_to(self, place_m: FloatArray, pose: Pose2, grid: OccupancyGrid) -> Drive:
        """To a place (2,) of the map first, for a robot at `pose`; then it goes on as before.

        Raises
        ------
        StateError
            When no known way leads there; nothing has changed then.
        """
        scene = self._look_around(pose, grid, self._strategy.reach_m)
        if self.blindness.is_sure(pose, grid):
            raise StateError(f"goto: {self.blindness.why} nothing is driven to blindly")
        home = self.graph.nodes[0].pose
        errand = Errand(place_m, home)
        path = errand.path(scene)
        if path is None:
            _, why = Reach(scene, self.bounds, home).why_not(place_m)
            raise StateError(f"goto {place_m[0]:g} {place_m[1]:g}: cannot be reached: {why}")
        self._errand = errand
        return self._set_out(scene, path, "goto")

    def end(self, why: str, pose: Pose2, grid: OccupancyGrid) -> Drive | Finished:
        """Explore no more; home, if that is wanted, else finished: `why`."""
        scene = self._stand_and_look(pose, grid)
        if self.blindness.is_sure(pose, grid):
            return self._stay(scene)
        self._errand = None
        self._home.is_final = True
        return self._end(scene, self._home.ending or Ending(why, False))

    def forbid(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls from the next decision on."""
        self.bounds.zones = zones

    def _stand_and_look(self, pose: Pose2, grid: OccupancyGrid) -> Scene:
        self._pursuit.stands_at(pose)
        return self._look_around(pose, grid, self._strategy.reach_m)

    def _explore_on(self, scene: Scene) -> Drive | Finished:
        """The next gap; none left: what was given up once more, then the end."""
        why = self._limit_reached()
        if why is not None:
            return self._end(scene, Ending(why, False))
        if self._progress.is_stalled(scene.map.known_m2):
            self._pursuit.stalled(scene.pose)
        self._pursuit.learn_from_last_scan(scene)
        self._identify_neighbours(scene)
        while True:
            while (choice := self._choose(scene)) is not None:
                if isinstance(choice, Aim):
                    drive = self._drive_for(scene, choice)
                else:
                    drive = self._drive_to(scene, *choice)
                if drive is not None:
                    return drive
            if not self._pursuit.reopen(scene.pose):
                break
            scene.known_outlook = None
            self._ledger.update(scene)
        back = self._pursuit.step_back(scene.terrain)
        path = None if back is None else trip(scene, back.position_m, None)
        if path is not None:
            return self._set_out(scene, path, "for another look at what was given up")
        return self._end(scene, Ending("no reachable gap is left", True))

    def _limit_reached(self) -> str | None:
        if len(self.graph) >= self._config.max_scans:
            return f"max_scans = {self._config.max_scans} reached"
        return None

    def _stay(self, scene: Scene) -> Finished:
        """The end right here: nothing would be seen on the way home."""
        why = f"{self.blindness.why} no way home is driven blindly"
        self._ledger.conclude(scene)
        return finished(scene, self.graph, self.bounds, Ending(why, False), why)

    def _end(self, scene: Scene, ending: Ending) -> Drive | Finished:
        """The way home before the end."""
        self._identify_neighbours(scene)
        if not scene.map.is_free.any():
            ending = Ending("the LRF shows no free ground here: is it covered?", False)
        step = self._home.step(scene, ending)
        if isinstance(step, str):
            self._ledger.conclude(scene)
            return finished(scene, self.graph, self.bounds, ending, step)
        return self._set_out(scene, step, f"home, for {ending.reason}")

    def _set_out(self, scene: Scene, path: PlannedPath, why: str) -> Drive:
        """A drive that is for no gap."""
        node = self.graph.nodes[-1]
        reason = f"{why}: {path.length_m:.1f} m to drive"
        drive = self._drive(scene, path, node, NO_GAP, reason)
        self._pursuit.set_out(
            Target(
                drive=drive,
                node=node,
                gap=None,
                targets_m=np.zeros((0, 2)),
                memory=scene.barren,
            )
        )
        return drive

    def _drive(
        self, scene: Scene, path: PlannedPath, node: Node, gap_id: int, reason: str
    ) -> Drive:
        home_m = way_home_m(scene, self.graph)
        return Drive(path=path, node_id=node.id, gap_id=gap_id, reason=reason, home_m=home_m)

    def report_failure(self, decision: Drive, why: str) -> None:
        """The goal could not be reached: it waits, is tried once more, then given up.

        At the end it gets another chance, from another place.
        """
        self._pursuit.failed(decision, why)
        self._errand = None

    def as_json(self) -> dict[str, Any]:
        """`nodes` with their `gaps`, for graph.json."""
        return self.graph.as_json()

    def _look_around(
        self, pose: Pose2, grid: OccupancyGrid, reach_m: float = math.inf
    ) -> Scene:
        return Scene(
            pose=pose,
            map=grid,
            body=self._body,
            limits=partial(self.bounds.masks, self.graph.nodes[0].pose, pose),
            driven_m=self._ways.places_m,
            barren=self._barren,
            edge_min_m=self._config.frontier_min_m,
            reach_m=reach_m,
            looks_on_the_way=self._looks_on_the_way,
        )

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
            neighbour_range_m=min(self._config.neighbour_range_m, scene.reach_m),
            robot_width_m=self._rules.robot_width_m,
            terrain=scene.terrain,
            is_seen=is_seen,
        )

    def _choose(self, scene: Scene) -> Candidate | Aim | None:
        """The strategy's gap or place."""
        newest = len(self.graph) - 1
        return self._strategy.choose(
            Situation(
                graph=self.graph,
                current=newest,
                costs_m=lambda: self.graph.costs_from(newest),
                candidates=lambda: self._ledger.candidates(scene),
                all_left=lambda: self._ledger.all_left(scene),
                edge_m=partial(self._ledger.edge_m, scene),
                outlook=lambda: scene.outlook(self._range_m, self._vain, self.graph),
            )
        )

    def _drive_for(self, scene: Scene, aim: Aim) -> Drive | None:
        """The way to a place the strategy chose; what it is for becomes a gap.

        None where that has been given up: then it must choose another one.
        """
        found = gap_of_aim(scene, self.graph, aim, self._sector_half_rad, self._aimed)
        if found.gap.failures >= FAILURES_MAX:
            self._vain.strike(found.targets_m, STRIKES)
            scene.known_outlook = None
            return None
        if not found.gap.is_open:  # out of reach then
            found.gap.set(GapState.UNEXPLORED, "")
        self._aimed.append(found)
        path = plan(scene.terrain, scene.pose, aim.cell, found.heading_rad)
        reason = f"{self._strategy.name}: {aim.why}, {path.length_m:.1f} m to drive"
        drive = self._drive(scene, path, found.node, found.gap.id, reason)
        self._pursuit.set_out(
            Target(
                drive=drive,
                node=found.node,
                gap=found.gap,
                targets_m=found.targets_m,
                memory=self._vain,
                heeds_looks=aim.heeds_looks,
            )
        )
        return drive

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
        targets = scene.targets[node.index, gap.id]
        drive = self._drive(scene, path, node, gap.id, reason)
        self._pursuit.set_out(
            Target(
                drive=drive,
                node=node,
                gap=gap,
                targets_m=targets,
                memory=scene.barren,
                is_retraced=len(via) > 1,
            )
        )
        return drive
