# SPDX-License-Identifier: MIT
"""Neighbour identification after each scan (the paper's step 03, rules A, B and C).

A: nodes closer than twice the scan range are looked at, the ground between them being explored.
B: gaps of either node that the line joining them crosses become explored.
C: where those gaps are wider than the robot the nodes become neighbours.

The paper's rules can mark unseen ground as explored. With the visibility guard, B closes a gap
only where nothing unseen shows from it, and C asks the map for a drivable way about as long as
the straight line instead of trusting the line. Without the guard both are as printed; where
a node's scan shows no gap on the line, the line must be free up to the other node.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import transform_points
from ins_robot.navigation.gaps import Gap, GapKind, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.terrain import Terrain

DETOUR = 1.4  # a way this much longer than the straight line still joins two nodes directly
DETOUR_M = 0.3
CLEAR_SHARE = 0.95  # a reading this near to the other node's distance is as good as beyond it

IsSeen = Callable[[Node, Gap], bool]


def identify_neighbours(
    graph: NodeGraph,
    new: Node,
    *,
    neighbour_range_m: float,
    robot_width_m: float,
    terrain: Terrain,
    is_seen: IsSeen | None,
) -> None:
    """Apply the rules between a new node and all others.

    Parameters
    ----------
    terrain : Terrain
        Priced from the new node, where the robot stands.
    is_seen : callable or None
        With the visibility guard: whether nothing unseen shows from a gap. None: no guard.
    """
    positions = graph.positions_m()
    away_m = np.hypot(*(positions - new.position_m).T)
    driven_m = terrain.cost_near_m(positions)
    if new.came_from is not None:
        graph.link(new.index, new.came_from, _cost(driven_m, away_m, new.came_from))
    near = [graph.nodes[index] for index in np.flatnonzero(away_m < neighbour_range_m)]  # A
    near = [other for other in near if other is not new]
    with_closed = is_seen is None  # else the map is asked, not they
    for other, crossed in zip(near, _crossed(new, near, with_closed), strict=True):
        index = other.index
        for node, gap in crossed:  # B
            if gap.is_open and (is_seen is None or is_seen(node, gap)):
                gap.set(GapState.EXPLORED, f"lies between nodes {new.id} and {other.id}")
        if is_seen is not None:
            joined = driven_m[index] <= DETOUR * away_m[index] + DETOUR_M
        else:
            joined = all(gap.width_m >= robot_width_m for _, gap in crossed) and all(
                _looks_along(a, b, crossed) for a, b in ((new, other), (other, new))
            )
        if joined:  # C
            graph.link(new.index, other.index, _cost(driven_m, away_m, index))


def _cost(driven_m: FloatArray, away_m: FloatArray, index: int) -> float:
    """What the way costs on the map; the straight distance where the map knows none."""
    return float(driven_m[index] if math.isfinite(driven_m[index]) else away_m[index])


def _crossed(new: Node, others: list[Node], with_closed: bool) -> list[list[tuple[Node, Gap]]]:
    """For each of `others` the gaps, of both nodes, that the line to it crosses."""
    asked = [
        (number, node, gap)
        for number, other in enumerate(others)
        for node in (new, other)
        for gap in node.gaps
        if gap.kind is GapKind.OPENING and (gap.is_open or with_closed)
    ]
    crossed: list[list[tuple[Node, Gap]]] = [[] for _ in others]
    if not asked:
        return crossed
    poses = np.array([(p.x_m, p.y_m, p.heading_rad) for p in (n.pose for _, n, _ in asked)])
    ends = transform_points(poses, np.array([gap.ends_m for _, _, gap in asked]))
    towards = np.array([other.position_m for other in others])[[n for n, _, _ in asked]]
    hit = crosses(new.position_m, towards, ends[:, 0], ends[:, 1])
    for (number, node, gap), is_hit in zip(asked, hit.tolist(), strict=True):
        if is_hit:
            crossed[number].append((node, gap))
    return crossed


def crosses(a: FloatArray, b: FloatArray, starts: FloatArray, ends: FloatArray) -> np.ndarray:
    """(N,) bool: which segments from starts to ends (N, 2) meet those from a to b.

    `a` and `b` are (2,), or (N, 2): one for each.
    """

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        return np.asarray(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    apart = side(a, b, starts) * side(a, b, ends) <= 0.0
    across = side(starts, ends, a) * side(starts, ends, b) <= 0.0
    return np.asarray(apart & across)


def _looks_along(node: Node, other: Node, crossed: list[tuple[Node, Gap]]) -> bool:
    """Whether the node's scan lets the line to the other pass, in the clear or by a gap."""
    if any(owner is node for owner, _ in crossed):
        return True
    away_m = math.hypot(*(other.position_m - node.position_m))
    return node.range_towards_m(other.position_m) >= CLEAR_SHARE * away_m
