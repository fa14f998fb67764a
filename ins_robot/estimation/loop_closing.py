# SPDX-License-Identifier: MIT
"""Loop closures: the robot is back at a place that it knows by another way.

Candidates are nodes near enough for the drift since, but not linked to the present ones. The
scan is searched for in their local map, aligned, and must fit well as far as they know the
place, be unambiguous, and be confirmed by the next nodes' closures, since a false closure is
worse than none. The more of them say the same, the more the rest of the graph may pay for it:
a scan that was laid wrong on the way is overruled. Old nodes that are linked are rechecked on
their own the same way: a loop closed a little wrong pulls straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ins_robot.estimation.node_map import LINK_RADIUS_M, NodeMap
from ins_robot.estimation.scan_matching import Alignment, SearchResult, align, search
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import compose, inverse, transform_points
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import IntArray
from ins_robot.mapping.surfels import Surfels

DRIFT_M = 0.25  # search at least this far ...
DRIFT_PER_M = 0.03  # ... and this much more per metre driven since
DRIFT_MAX_M = 2.5
TURN_RAD = math.radians(4.0)
TURN_PER_M = math.radians(0.3)
TURN_MAX_RAD = math.radians(20.0)
FAR_M = 50.0  # after so long a way, where nothing is found so near, it is looked ...
FAR_DRIFT_PER_M = 0.06
FAR_DRIFT_MAX_M = 5.0  # ... this far
FAR_TURN_RAD = math.radians(25.0)
NEAR_M = 3.0  # a scan that near to the old nodes must see what they saw
RIVAL_RATIO_MAX = 0.92
PARTLY_RIVAL_RATIO_MAX = 0.86  # a false loop of such scans had 0.85 to 0.92
KNOWN_SHARE_MIN = 0.8
INLIERS_MIN = 30
STD_MAX_M = 0.06  # of the weakest direction: a closure that slides is none
CONFIRMATIONS = 2  # later closures that must agree
AGREE_M = 0.2
AGREE_RAD = math.radians(2.5)
OLD_M = 15.0  # nodes this much driving ago are checked on their own, though linked
RECHECK_RADIUS_M = 5.0
RECHECK_NODES_MIN = 2
RECHECK_EVERY = 3  # nodes; every one while a closure waits for confirmation
RECHECK_M = 0.4
RECHECK_RAD = math.radians(4.0)
COST_EACH = 10.0  # chi-squared that a loop may cost for each that says so: true ones up to 15
COST_MAX = 120.0  # however many: true ones that were needed took up to 90
SETTLED_M = 0.02
SETTLED_RAD = math.radians(0.4)
EVIDENT_MOVE_M = 0.5
EVIDENT_INLIER_SHARE = 0.85
EVIDENT_INLIERS = 120
EVIDENT_RIVAL_RATIO = 0.8
PATIENCE = 4  # nodes within which they must


class Demand(NamedTuple):
    """How much of a scan must lie on the old nodes' map."""

    value_min: float
    inlier_share_min: float


PLAIN = Demand(0.5, 0.6)
PARTLY = Demand(0.35, 0.4)  # the rest must be what the old scans did not see past


@dataclass(frozen=True, slots=True, kw_only=True)
class Closure:
    """A node found again in an old part of the map."""

    node: int
    pose: FloatArray
    match: Alignment
    correction: FloatArray  # map_new_from_map_old at the node, (3,)
    moved_m: float
    turned_rad: float
    rival_ratio: float

    @property
    def is_settled(self) -> bool:
        """Whether the map agreed already."""
        return self.moved_m < SETTLED_M and self.turned_rad < SETTLED_RAD

    @property
    def is_evident(self) -> bool:
        """Whether nothing more needs to confirm it: a small move onto a near-perfect fit."""
        return (
            self.moved_m < EVIDENT_MOVE_M
            and self.match.inlier_share > EVIDENT_INLIER_SHARE
            and self.match.inliers > EVIDENT_INLIERS
            and self.rival_ratio < EVIDENT_RIVAL_RATIO
        )


@dataclass(slots=True)
class Train:
    """Closures in a row that correct the map alike; the cost for which they were refused."""

    closures: list[Closure]
    refused_cost: float = 0.0

    @property
    def is_ripe(self) -> bool:
        """Whether enough of them confirm each other to be tried, again if they were refused."""
        is_confirmed = len(self.closures) > CONFIRMATIONS or self.closures[-1].is_evident
        return is_confirmed and self.refused_cost <= self._cost_max

    @property
    def _cost_max(self) -> float:
        return min(COST_EACH * max(len(self.closures), CONFIRMATIONS + 1), COST_MAX)

    def close(self, nodes: NodeMap) -> bool:
        """Link what they say and relax the graph, or leave it as it was: then False.

        A loop that drifted lets itself be closed at little cost. Where one part of a corridor
        was taken for another, all edges of the way there have to be stretched beyond what they
        know. Closures that are settled are linked, but nothing needs to move for them.
        """
        if all(closure.is_settled for closure in self.closures):
            self._link(nodes)
            return True
        graph = nodes.graph
        before = graph.checkpoint()
        cost = graph.cost(before.edges)
        self._link(nodes)
        graph.relax(firm_from=before.edges)
        cost = graph.cost(before.edges) - cost
        if cost <= self._cost_max:
            return True
        graph.restore(before)
        self.refused_cost = cost
        return False

    def _link(self, nodes: NodeMap) -> None:
        for closure in self.closures:
            nodes.link_match(closure.node, closure.pose, closure.match, is_closure=True)


class LoopCloser:
    """Finds closures node by node and closes the loop once they confirm each other."""

    def __init__(self) -> None:
        self._trains: list[Train] = []

    def forget(self) -> None:
        """The map has moved by more than closures: what waits to be confirmed is void."""
        self._trains = []

    def close(self, nodes: NodeMap, node: int, linked: IntArray, scan: Surfels) -> bool:
        """Whether a loop was closed by what `node` sees, and the map has moved; mostly not."""
        found = self._search(nodes, node, linked, scan) or self._recheck(
            nodes, node, linked, scan
        )
        self._trains = [t for t in self._trains if node - t.closures[-1].node <= PATIENCE]
        if found is None:
            return False
        if found.is_settled:
            Train([found]).close(nodes)
            return False
        train = self._joined(found)
        if not (train.is_ripe and train.close(nodes)):
            return False
        self._trains = []
        return True

    def _joined(self, found: Closure) -> Train:
        """The train that a closure goes on with: of those it agrees with, all that do."""
        agreeing: list[Train] = []
        others: list[Train] = []
        for train in self._trains:
            is_alike = any(_agree(closure, found) for closure in train.closures)
            (agreeing if is_alike else others).append(train)
        before = [closure for train in agreeing for closure in train.closures]
        joined = Train(
            [*(closure for closure in before if _agree(closure, found)), found],
            max((train.refused_cost for train in agreeing), default=0.0),
        )
        self._trains = [*others, joined]
        return joined

    def _search(
        self, nodes: NodeMap, node: int, linked: IntArray, scan: Surfels
    ) -> Closure | None:
        pose = nodes.graph.poses[node].copy()
        driven_m = nodes.travelled_m[node] - nodes.travelled_m
        drift = np.minimum(DRIFT_M + DRIFT_PER_M * driven_m, DRIFT_MAX_M)
        distance = np.hypot(*(nodes.graph.poses[:, :2] - pose[:2]).T)
        is_candidate = distance < drift + NEAR_M
        is_candidate[linked] = False
        is_candidate[node] = False
        if not is_candidate.any():
            return None
        centre = int(np.flatnonzero(is_candidate)[np.argmin(distance[is_candidate])])
        is_near = nodes.near(pose, LINK_RADIUS_M)
        is_near[linked] = False
        driven = float(driven_m[centre])
        windows = [
            (float(drift[centre]), min(TURN_RAD + TURN_PER_M * driven, TURN_MAX_RAD)),
        ]
        if driven > FAR_M:
            far_m = min(DRIFT_M + FAR_DRIFT_PER_M * driven, FAR_DRIFT_MAX_M)
            windows.append((far_m, FAR_TURN_RAD))
        candidates = nodes.graph.linked(np.array([centre]), is_near)
        return self._fit(nodes, node, candidates, scan, windows, PARTLY)

    def _recheck(
        self, nodes: NodeMap, node: int, linked: IntArray, scan: Surfels
    ) -> Closure | None:
        """Where the old part of the linked map, taken alone, puts the node."""
        if node % RECHECK_EVERY and not self._trains:
            return None
        driven_m = nodes.travelled_m[node] - nodes.travelled_m[linked]
        is_near = nodes.near(nodes.graph.poses[node], RECHECK_RADIUS_M)[linked]
        old = linked[(driven_m > OLD_M) & is_near]
        if len(old) < RECHECK_NODES_MIN:
            return None
        return self._fit(nodes, node, old, scan, [(RECHECK_M, RECHECK_RAD)], PLAIN)

    def _fit(
        self,
        nodes: NodeMap,
        node: int,
        candidates: IntArray,
        scan: Surfels,
        windows: list[tuple[float, float]],
        demand: Demand,
    ) -> Closure | None:
        """Where the scan fits the map of the candidates, in the first window that has it."""
        pose = nodes.graph.poses[node].copy()
        field = nodes.local_field(candidates, pose)
        if field is None:
            return None
        best = _best_of(field, scan, pose, windows, demand.value_min)
        if best is None:
            return None
        # a prior too weak to decide anything, only to keep the equations regular
        match = align(field, scan, best.pose[None], best.pose, np.diag([4.0, 4.0, 30.0]))
        if not _is_held(match, demand):
            return None
        if match.inlier_share < PLAIN.inlier_share_min:
            is_rivalled = best.rival_value > PARTLY_RIVAL_RATIO_MAX * best.value
            if is_rivalled or _known_share(nodes, candidates, scan, match) < KNOWN_SHARE_MIN:
                return None
        correction = compose(match.pose, inverse(pose))
        return Closure(
            node=node,
            pose=match.pose,
            match=match,
            correction=correction,
            moved_m=math.dist(match.pose[:2], pose[:2]),
            turned_rad=abs(wrap_rad(float(match.pose[2] - pose[2]))),
            rival_ratio=best.rival_value / best.value,
        )


def _best_of(
    field: LikelihoodField,
    scan: Surfels,
    pose: FloatArray,
    windows: list[tuple[float, float]],
    value_min: float,
) -> SearchResult | None:
    """The best place in the windows, up to the first good one; None if others do as well."""
    best: SearchResult | None = None
    for half_width_m, half_turn_rad in windows:
        found = search(field, scan, pose, half_width_m, half_turn_rad)
        if best is None or found.value > best.value:
            best = found
        if best.value >= PLAIN.value_min:
            break
    if best is None or best.value < value_min:
        return None
    return best if best.rival_value <= RIVAL_RATIO_MAX * best.value else None


def _is_held(match: Alignment, demand: Demand) -> bool:
    """Whether enough of the scan is on the map, and holds it in all directions."""
    if match.inlier_share < demand.inlier_share_min or match.inliers < INLIERS_MIN:
        return False
    weakest = float(np.linalg.eigvalsh(match.information[:2, :2])[0])
    return weakest >= 1.0 / STD_MAX_M**2


def _known_share(
    nodes: NodeMap, candidates: IntArray, scan: Surfels, match: Alignment
) -> float:
    """Share of the readings on the map, of all that are there or that old scans saw past."""
    candidates = candidates[nodes.near(match.pose, LINK_RADIUS_M)[candidates]]
    if not len(candidates):
        return 0.0
    others = transform_points(match.pose, scan.points_m[~match.is_inlier])
    denied = int(nodes.seen_past(candidates, others).sum())
    return match.inliers / (match.inliers + denied)


def _agree(one: Closure, other: Closure) -> bool:
    """Whether two closures correct the map alike, where the second one is."""
    a = compose(one.correction, compose(inverse(other.correction), other.pose))
    off = a - other.pose
    return bool(np.hypot(off[0], off[1]) < AGREE_M and abs(wrap_rad(float(off[2]))) < AGREE_RAD)
