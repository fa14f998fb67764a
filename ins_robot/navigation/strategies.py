# SPDX-License-Identifier: MIT
"""What next: the one choice in which the strategies differ.

Each strategy sees the same situation and names a gap (which is then scanned from where the
explorer thinks best), or the place to scan from itself. On the graph: `min-gap` is the paper's,
`max-gap` is what the paper compares it with, `backtrack` the traditional way it argues against
(its section 4). On the grid: the field's frontier strategies, and `auto`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import cached_property
from typing import Protocol

from ins_robot.geometry.angles import FloatArray
from ins_robot.navigation.auto import Auto
from ins_robot.navigation.frontier_tour import FrontierTour
from ins_robot.navigation.frontiers import ExploreLite, NearestFrontier, NextBestView
from ins_robot.navigation.gaps import Gap
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.outlook import Aim, Outlook

Candidate = tuple[Node, Gap]


class Situation:
    """What a strategy chooses from; the dear parts are worked out when first asked for.

    Attributes
    ----------
    current : int
        Index of the node the robot is at, or was last.
    """

    def __init__(
        self,
        *,
        graph: NodeGraph,
        current: int,
        costs_m: Callable[[], FloatArray],
        candidates: Callable[[], Collection[Candidate]],
        outlook: Callable[[], Outlook],
    ) -> None:
        self.graph, self.current = graph, current
        self._find_costs_m = costs_m
        self._find_candidates, self._find_outlook = candidates, outlook

    @cached_property
    def costs_m(self) -> FloatArray:
        """(K,) travel-cost map: from the current node to every node; inf: no way is known."""
        return self._find_costs_m()

    @cached_property
    def candidates(self) -> Collection[Candidate]:
        """Unexplored passable gaps."""
        return self._find_candidates()

    @property
    def outlook(self) -> Outlook:
        """Grid, ground and edges, as far around as has been looked."""
        return self._find_outlook()

    def of_node(self, index: int) -> list[Gap]:
        """The candidates of one node."""
        return [gap for node, gap in self.candidates if node.index == index]


class Strategy(Protocol):
    """A way to choose.

    `replan_m`: a robot that scans on the way chooses anew after so much of it. `reach_m`: ways
    no dearer are looked for first, and farther on only when asked; inf: everywhere at once.
    """

    name: str
    replan_m: float
    reach_m: float

    def choose(self, situation: Situation) -> Candidate | Aim | None:
        """Where to scan next; None when there is nothing left."""

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """Nodes to pass from the newest one to `node`, in order; empty: the shortest way."""


class PlaceChooser(Protocol):
    """A way to choose a place on an outlook, without a graph."""

    name: str
    replan_m: float
    reach_m: float

    def aim(self, outlook: Outlook) -> Aim | None:
        """The place to scan from; None when no edge is worth it."""


class OnOutlook:
    """A place chooser as a strategy; what it leaves is left to the paper's."""

    def __init__(self, chooser: PlaceChooser) -> None:
        self.name, self.replan_m = chooser.name, chooser.replan_m
        self.reach_m = chooser.reach_m
        self._chooser = chooser
        self._rest = CheapestNode("min-gap", narrowest)
        self._exhausted: Outlook | None = None  # nothing was found on it: not asked twice

    def choose(self, situation: Situation) -> Candidate | Aim | None:
        """A place while there is one, then a gap."""
        if situation.outlook is not self._exhausted:
            aim = self._chooser.aim(situation.outlook)
            if aim is not None:
                return aim
            self._exhausted = situation.outlook
        return self._rest.choose(situation)

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """No node in between."""
        return []


class CheapestNode:
    """The cheapest node with an unexplored gap (paper, step 03), and in it the gap by width."""

    replan_m = math.inf
    reach_m = math.inf

    def __init__(self, name: str, pick: Callable[[list[Gap]], Gap]) -> None:
        self.name = name
        self._pick = pick

    def choose(self, situation: Situation) -> Candidate | None:
        """Cheapest node; of nodes that cost the same the later one."""
        indices = {node.index for node, _ in situation.candidates}
        if not indices:
            return None
        best = min(indices, key=lambda index: (situation.costs_m[index], -index))
        return situation.graph.nodes[best], self._pick(situation.of_node(best))

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """No node in between: the shortest way."""
        return []


class Backtrack:
    """Back along the order of traversal to the last node with an unexplored gap."""

    name = "backtrack"
    replan_m = math.inf
    reach_m = math.inf

    def choose(self, situation: Situation) -> Candidate | None:
        """First such node on the way back; then, if the way back has none, the latest one."""
        indices = {node.index for node, _ in situation.candidates}
        if not indices:
            return None
        back = self._way_back(situation.graph, situation.current)
        best = next((index for index in back if index in indices), max(indices))
        return situation.graph.nodes[best], narrowest(situation.of_node(best))

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """The nodes of the way back, as far as `node` (over the first common one)."""
        back = self._way_back(graph, len(graph) - 1)
        there = self._way_back(graph, node.index)
        common = next((index for index in back if index in there), None)
        if common is None:
            return []
        down = there[: there.index(common)][::-1]
        return [*back[: back.index(common) + 1], *down]

    @staticmethod
    def _way_back(graph: NodeGraph, index: int) -> list[int]:
        way = [index]
        while (before := graph.nodes[way[-1]].came_from) is not None:
            way.append(before)
        return way


def narrowest(gaps: list[Gap]) -> Gap:
    """The paper's choice: a small gap is likelier to lead to a dead end, soon done with."""
    return min(gaps, key=lambda gap: (gap.width_m, gap.id))


def widest(gaps: list[Gap]) -> Gap:
    """What the paper compares with."""
    return max(gaps, key=lambda gap: (gap.width_m, -gap.id))


GAP_STRATEGIES: dict[str, Callable[[], Strategy]] = {
    "min-gap": lambda: CheapestNode("min-gap", narrowest),
    "max-gap": lambda: CheapestNode("max-gap", widest),
    "backtrack": Backtrack,
}
PLACE_CHOOSERS: dict[str, Callable[[], PlaceChooser]] = {
    "nearest-frontier": NearestFrontier,
    "explore-lite": ExploreLite,
    "next-best-view": NextBestView,
    "tsp-frontier": FrontierTour,
    "auto": Auto,
}
STRATEGY_NAMES = (*GAP_STRATEGIES, *PLACE_CHOOSERS)


def make_strategy(name: str) -> Strategy:
    """The strategy of a configuration's name."""
    if name in GAP_STRATEGIES:
        return GAP_STRATEGIES[name]()
    if name == Auto.name:
        return OnOutlook(Auto(is_alone=False))
    return OnOutlook(PLACE_CHOOSERS[name]())
