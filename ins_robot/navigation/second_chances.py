# SPDX-License-Identifier: MIT
"""Given-up goals get one more try, from another place than where they failed.

Refusals and poses in, gaps opened again out. Without a place to try from, the robot first goes
to one where it has scanned before, and looks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import Gap, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.terrain import Terrain
from ins_robot.navigation.unseen import BarrenEdges

ELSEWHERE_M = 0.5  # another pose is at least this far from where a goal was refused


@dataclass(slots=True)
class _Refusal:
    gap: Gap
    targets_m: FloatArray
    at_m: FloatArray | None = None
    was_retried: bool = False


class SecondChances:
    """Memory of what was given up, and where the robot stood then."""

    def __init__(self, graph: NodeGraph, barren: BarrenEdges, vain: BarrenEdges) -> None:
        self._graph, self._barren, self._vain = graph, barren, vain
        self._refusals: dict[tuple[int, int], _Refusal] = {}
        self._has_stepped_back = False

    def refused(self, node: Node, gap: Gap, targets_m: FloatArray) -> None:
        """A goal was not reached; `stands_at` will tell from where."""
        before = self._refusals.get((node.index, gap.id))
        if before is None:
            self._refusals[node.index, gap.id] = _Refusal(gap, targets_m)
        else:
            before.at_m = None

    def stands_at(self, pose: Pose2) -> None:
        """Where the robot is when it decides anew."""
        for refusal in self._refusals.values():
            if refusal.at_m is None:
                refusal.at_m = np.array([pose.x_m, pose.y_m])

    def reopen(self, pose: Pose2) -> bool:
        """Open again what was given up elsewhere than here, each gap once; whether any was."""
        here = np.array([pose.x_m, pose.y_m])
        ready = [r for r in self._waiting() if np.hypot(*(r.at_m - here)) >= ELSEWHERE_M]
        for refusal in ready:
            refusal.was_retried = True
            refusal.gap.failures -= 1
            refusal.gap.is_deferred = False
            refusal.gap.set(GapState.UNEXPLORED, "")
            self._barren.pardon_once(refusal.targets_m)
            self._vain.pardon_once(refusal.targets_m)
        return bool(ready)

    def step_back(self, terrain: Terrain) -> Node | None:
        """The cheapest node to try from, when all were given up right here; asked once."""
        waiting = self._waiting()
        if not waiting or self._has_stepped_back:
            return None
        self._has_stepped_back = True
        positions = self._graph.positions_m()
        failed = np.array([refusal.at_m for refusal in waiting])
        away = np.hypot(*(positions[:, None] - failed[None]).transpose(2, 0, 1)).min(axis=1)
        costs = np.where(away >= ELSEWHERE_M, terrain.cost_near_m(positions), np.inf)
        best = int(costs.argmin())
        return self._graph.nodes[best] if np.isfinite(costs[best]) else None

    def _waiting(self) -> list[_Refusal]:
        return [
            refusal
            for refusal in self._refusals.values()
            if not refusal.was_retried and refusal.gap.state is GapState.UNREACHABLE
        ]
