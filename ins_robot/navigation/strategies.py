# SPDX-License-Identifier: MIT
"""Which gap next: the one choice in which the strategies differ.

Each strategy sees the same situation (graph, where the robot is, what each node costs to reach)
and names a gap. `min-gap` is the paper's; `max-gap` is what the paper compares it with;
`backtrack` is the traditional way it argues against (its section 4).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol

from ins_robot.geometry.angles import FloatArray
from ins_robot.navigation.gaps import Gap
from ins_robot.navigation.node_graph import Node, NodeGraph

Candidate = tuple[Node, Gap]


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What a strategy chooses from.

    Attributes
    ----------
    current : int
        Index of the node the robot is at, or was last.
    costs_m : (K,) float64
        Travel-cost map: from the current node to every node; inf where no way is known.
    candidates : collection of (node, gap)
        Unexplored passable gaps.
    """

    graph: NodeGraph
    current: int
    costs_m: FloatArray
    candidates: Collection[Candidate]

    def of_node(self, index: int) -> list[Gap]:
        """The candidates of one node."""
        return [gap for node, gap in self.candidates if node.index == index]


class Strategy(Protocol):
    """A way to choose."""

    name: str

    def choose(self, situation: Situation) -> Candidate | None:
        """The gap to go to, None when there is no candidate."""

    def retraces(self, graph: NodeGraph, node: Node) -> list[int]:
        """Nodes to pass from the newest one to `node`, in order; empty: the shortest way."""


class CheapestNode:
    """The cheapest node with an unexplored gap (paper, step 03), and in it the gap by width."""

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


def make_strategy(name: str) -> Strategy:
    """The strategy of a configuration's name."""
    strategies: dict[str, Callable[[], Strategy]] = {
        "min-gap": lambda: CheapestNode("min-gap", narrowest),
        "max-gap": lambda: CheapestNode("max-gap", widest),
        "backtrack": Backtrack,
    }
    return strategies[name]()
