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
from ins_robot.navigation.gaps import Gap, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.outlook import Aim, Outlook
from ins_robot.navigation.rounds import first_stop

Candidate = tuple[Node, Gap]
RICH = 0.12  # m2 (to the power it counts with) per metre: 0.5 m2 5 m away, 2 m2 13 m away
EDGE_PER_WAY = 0.03  # what shows less edge for its way is left: 0.3 m for 10 m


class Situation:
    """What a strategy chooses from; the dear parts are worked out when first asked for.

    Attributes
    ----------
    current : int
        Index of the node the robot is at, or was last.
    edge_m : callable
        How much edge of the seen part a scan at one of `all_left` should show.
    """

    def __init__(
        self,
        *,
        graph: NodeGraph,
        current: int,
        costs_m: Callable[[], FloatArray],
        candidates: Callable[[], Collection[Candidate]],
        outlook: Callable[[], Outlook],
        all_left: Callable[[], Collection[Candidate]] = tuple,
        edge_m: Callable[[Node, Gap], float] = lambda node, gap: math.inf,
    ) -> None:
        self.graph, self.current = graph, current
        self._find_costs_m = costs_m
        self._find_candidates, self._find_outlook = candidates, outlook
        self._find_all_left, self.edge_m = all_left, edge_m

    @cached_property
    def costs_m(self) -> FloatArray:
        """(K,) travel-cost map: from the current node to every node; inf: no way is known."""
        return self._find_costs_m()

    @cached_property
    def candidates(self) -> Collection[Candidate]:
        """Unexplored passable gaps."""
        return self._find_candidates()

    @cached_property
    def all_left(self) -> Collection[Candidate]:
        """Unexplored passable gaps, and edges that no gap leads to."""
        return self._find_all_left()

    def forget_what_is_left(self) -> None:
        """Ask for it again: states of gaps have been changed."""
        del self.all_left

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
        return self._aim(situation) or self._rest.choose(situation)

    def _aim(self, situation: Situation) -> Aim | None:
        if situation.outlook is self._exhausted:
            return None
        aim = self._chooser.aim(situation.outlook)
        if aim is None:
            self._exhausted = situation.outlook
        return aim

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """No node in between."""
        return []


class LastRounds(OnOutlook):
    """`auto` while it is worth the way; then a tour of all that is left, to end at home."""

    def choose(self, situation: Situation) -> Candidate | Aim | None:
        """The best place; where that is far for little, what is first on a tour of all."""
        aim = self._aim(situation)
        if aim is not None and aim.worth >= RICH:
            return aim
        while situation.all_left:
            left = [one for one in situation.all_left if _is_worth_it(situation, *one)]
            if left:
                return self._first(situation, aim, left)
            situation.forget_what_is_left()
        return aim

    def _first(
        self, situation: Situation, aim: Aim | None, left: list[Candidate]
    ) -> Candidate | Aim:
        stops = {node.index for node, _ in left}
        beside = -1
        if aim is not None:
            off = situation.outlook.looks.cells - aim.cell
            beside = int((off**2).sum(axis=1).argmin())
            stops.add(beside)
        first = first_stop(situation.graph, situation.current, stops)
        if aim is not None and first == beside:
            return aim
        gaps = [gap for node, gap in left if node.index == first]
        return situation.graph.nodes[first], narrowest(gaps)


def _is_worth_it(situation: Situation, node: Node, gap: Gap) -> bool:
    """Whether enough may show from a gap for the way to it; else it says so itself."""
    edge_m, way_m = situation.edge_m(node, gap), float(situation.costs_m[node.index])
    if edge_m >= EDGE_PER_WAY * way_m or math.isinf(way_m):  # inf: only the grid knows a way
        return True
    gap.set(GapState.NOT_WORTH_IT, f"{edge_m:.2f} m of edge, {way_m:.0f} m to drive")
    return False


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
        return LastRounds(Auto(is_alone=False))
    return OnOutlook(PLACE_CHOOSERS[name]())
