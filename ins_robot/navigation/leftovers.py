# SPDX-License-Identifier: MIT
"""What a run leaves unseen, and why: every edge of the seen part of the map, one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.gaps import GapState
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.reach import Reach
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.unseen import BarrenEdges, survey_unseen

NEAR_M = 0.7  # a refused gap this near tells why an edge was left
NOTHING_NEW = "nothing_new"


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftover:
    """An edge beyond which nothing has been seen: where, how long, and why it was left."""

    x_m: float
    y_m: float
    length_m: float
    state: str
    why: str

    def as_json(self) -> dict[str, Any]:
        """JSON values for summary.json."""
        return {
            "x_m": round(self.x_m, 2),
            "y_m": round(self.y_m, 2),
            "length_m": round(self.length_m, 2),
            "state": self.state,
            "why": self.why,
        }


def leftovers(
    scene: Scene, graph: NodeGraph, bounds: Bounds, *, unfinished: str | None
) -> tuple[Leftover, ...]:
    """All edges left; `unfinished` says what ended the run before all was done."""
    unseen = survey_unseen(scene.grid, scene.edge_min_m, BarrenEdges())
    start = graph.nodes[0].pose
    reach = Reach(scene, bounds, start)
    found = []
    for edge in np.unique(unseen.edge_of):
        index = np.flatnonzero(unseen.edge_of == edge)
        points = unseen.points_m[index]
        middle = points[int(np.hypot(*(points - points.mean(axis=0)).T).argmin())]
        state, why = _reason(reach, graph, bounds, start, middle, unfinished)
        found.append(
            Leftover(
                x_m=float(middle[0]),
                y_m=float(middle[1]),
                length_m=len(index) * scene.grid.resolution_m,
                state=state,
                why=why,
            )
        )
    return tuple(found)


def _reason(
    reach: Reach,
    graph: NodeGraph,
    bounds: Bounds,
    start: Pose2,
    middle: np.ndarray,
    unfinished: str | None,
) -> tuple[str, str]:
    refusal = bounds.refusal(start, middle)
    if refusal is not None:
        return str(refusal[0]), refusal[1]
    told = _nearest_refusal(graph, middle)
    if told is not None:
        return told
    if not reach.is_reachable(middle):
        state, why = reach.why_not(middle)
        return str(state), why
    if unfinished is not None:
        return str(GapState.UNEXPLORED), unfinished
    return NOTHING_NEW, "scans there showed no more, or would not: glass, too dark, too small"


def _nearest_refusal(graph: NodeGraph, point_m: np.ndarray) -> tuple[str, str] | None:
    """State and reason of the nearest gap that was given up, or not worth the way."""
    best: tuple[float, str, str] | None = None
    for node, gap in graph.gaps():
        is_given_up = gap.failures > 0 and gap.state is GapState.UNREACHABLE
        if not is_given_up and gap.state is not GapState.NOT_WORTH_IT:
            continue
        away = float(np.hypot(*(node.centroid_m(gap) - point_m))) - 0.5 * gap.width_m
        if away < NEAR_M and (best is None or away < best[0]):
            best = away, str(gap.state), gap.why
    return None if best is None else best[1:]
