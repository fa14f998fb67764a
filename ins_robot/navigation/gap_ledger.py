# SPDX-License-Identifier: MIT
"""Which gaps are still worth a drive: the graph's gaps and a scene in, candidates out.

The guard says what shows from a gap; asking it is the dear part of a decision, so the answer is
kept and asked for again only where the map has changed since.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.gaps import Gap, GapKind, GapState
from ins_robot.navigation.guard import Guard, edges_of_gap
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.strategies import Candidate
from ins_robot.navigation.unseen import SIGHT_M

FAILURES_MAX = 2  # a goal refused this often is given up
PASSING = (  # may change by itself
    GapState.UNREACHABLE,
    GapState.NO_GO,
    GapState.OUTSIDE,
    GapState.NOT_WORTH_IT,
)
GIVEN_UP = (GapState.UNREACHABLE, GapState.NOT_WORTH_IT)  # by a choice, not by the map alone
WAY_STRIDE = 10  # of the densely remembered way, every so many places are looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """What showed from a gap when the newest node was `at_node`."""

    at_node: int
    targets_m: FloatArray


class GapLedger:
    """States of all gaps, kept up to date scene by scene."""

    def __init__(
        self,
        graph: NodeGraph,
        guard: Guard,
        bounds: Bounds,
        range_m: float,
    ) -> None:
        self._graph, self._guard = graph, guard
        self._bounds, self._range_m = bounds, range_m
        self._shown: dict[tuple[int, int], _Shown] = {}

    def forget(self) -> None:
        """The map has moved: ask again everywhere."""
        self._shown.clear()

    def targets_m(self, scene: Scene, node: Node, gap: Gap) -> FloatArray:
        """(T, 2) what a scan at the gap should show; nothing: it is explored."""
        key = (node.index, gap.id)
        known = self._shown.get(key)
        newest = len(self._graph) - 1
        if known is None or (known.at_node < newest and self._has_changed(node, gap)):
            targets = self._guard.targets_m(scene.unseen, self._graph, node, gap)
        else:
            targets = known.targets_m[~scene.barren.mask(known.targets_m)]
        self._shown[key] = _Shown(at_node=newest, targets_m=targets)
        return targets

    def is_seen(self, scene: Scene, node: Node, gap: Gap) -> bool:
        """Whether nothing unseen shows from the gap, as far as the scene tells."""
        around_m = SIGHT_M + gap.width_m
        return scene.holds(node.centroid_m(gap), around_m) and self._is_seen(scene, node, gap)

    def _is_seen(self, scene: Scene, node: Node, gap: Gap) -> bool:
        return len(self.targets_m(scene, node, gap)) == 0

    def _has_changed(self, node: Node, gap: Gap) -> bool:
        """Whether the newest scan, or a sweep on the way to it, may have shown more of it."""
        newest = self._graph.nodes[-1]
        places = [newest.position_m]
        if newest.came_from is not None:
            origin = self._graph.nodes[newest.came_from].pose
            places.extend(origin.apply(newest.came_by_m[::WAY_STRIDE]))
        away = np.array(places) - node.centroid_m(gap)
        reach_m = self._range_m + SIGHT_M + gap.width_m
        return bool(np.hypot(away[:, 0], away[:, 1]).min() <= reach_m)

    def update(self, scene: Scene) -> None:
        """Look at every gap again; what was out of reach may have come into it."""
        scene.widen(math.inf)
        scene.is_listed = True
        for _, gap in self._graph.gaps():
            if gap.state in PASSING and gap.failures < FAILURES_MAX:
                gap.set(GapState.UNEXPLORED, "")
        self._close_explored(scene)

    def conclude(self, scene: Scene) -> None:
        """The states to end with, when this scene was not listed to choose from.

        What was out of reach or not worth its way stays so, with its reason, unless all of it
        has been seen.
        """
        if scene.is_listed:
            return
        left = [
            (gap, gap.state, gap.why) for _, gap in self._graph.gaps() if gap.state in GIVEN_UP
        ]
        self.update(scene)
        for gap, state, why in left:
            if gap.is_open:
                gap.set(state, why)

    def _close_explored(self, scene: Scene) -> None:
        """Close the gaps from which nothing new shows; note what the others should show."""
        start = self._graph.nodes[0].pose
        asked = [
            (node, gap)
            for node, gap in self._graph.gaps()
            if gap.state in (GapState.UNEXPLORED, GapState.TOO_NARROW)
        ]
        places = np.array([node.centroid_m(gap) for node, gap in asked]).reshape(-1, 2)
        refusals = self._bounds.refusals(start, places)
        for (node, gap), refusal in zip(asked, refusals, strict=True):
            if refusal is not None:
                gap.set(*refusal)
                continue
            targets = self.targets_m(scene, node, gap)
            if len(targets) == 0:
                gap.set(GapState.EXPLORED, "nothing unseen shows from it")
            elif gap.is_open:
                scene.targets[node.index, gap.id] = targets

    def candidates(self, scene: Scene) -> list[Candidate]:
        """Gaps to choose from, in four steps; the next where the one before gives none.

        Open gaps; edges of the map that no gap leads to; what only narrow passages lead to;
        what was refused before.
        """
        if not scene.is_listed:
            self.update(scene)
        found = self._open(scene)
        if not found and self._adopt_edges(scene):
            found = self._open(scene)
        if not found and scene.squeeze():
            self.update(scene)
            scene.has_adopted = False  # edges that were out of reach may not be any more
            return self.candidates(scene)
        if not found:
            for _, gap in self._graph.gaps():
                gap.is_deferred = False
            found = self._open(scene)
        return found

    def all_left(self, scene: Scene) -> list[Candidate]:
        """Open gaps and edges that no gap leads to, all at once: what a tour goes round.

        None of them: what `candidates` has.
        """
        if not scene.is_listed:
            self.update(scene)
        self._adopt_edges(scene)
        return self._open(scene) or self.candidates(scene)

    def edge_m(self, scene: Scene, node: Node, gap: Gap) -> float:
        """How much edge of the seen part a scan at an open gap should show."""
        return len(scene.targets[node.index, gap.id]) * scene.grid.resolution_m

    def _open(self, scene: Scene) -> list[Candidate]:
        return [
            (node, gap)
            for node, gap in self._graph.gaps()
            if gap.is_open and not gap.is_deferred and (node.index, gap.id) in scene.targets
        ]

    def _adopt_edges(self, scene: Scene) -> bool:
        """Edges of the seen part that no gap leads to become gaps of the nearest node.

        Once a decision: an edge refused in this decision does not come back in it.
        """
        if scene.has_adopted:
            return False
        scene.has_adopted = True
        led_to: set[int] = set()
        for node, gap in self._graph.gaps():
            is_known_edge = gap.kind is GapKind.EDGE and gap.state in PASSING
            if gap.is_open or is_known_edge:
                index = edges_of_gap(scene.unseen, node, gap)
                led_to.update(scene.unseen.edge_of[index].tolist())
        if not self._guard.adopt_edges(scene.unseen, self._graph, led_to):
            return False
        self._close_explored(scene)
        return True
