# SPDX-License-Identifier: MIT
"""The nodes (where scans were taken), their gaps, and which node can be driven to from which.

Two nodes that can be travelled between are neighbours; the edge costs what the way costs.
Dijkstra gives the travel-cost map from any node to all others (the paper's steps 03 and 04).
`as_json` is what a run's graph.json holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import dijkstra

from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import Gap

EDGE_COST_MIN_M = 1e-6  # a stored zero would read as "no edge"


@dataclass(slots=True, kw_only=True)
class Node:
    """One place where a scan was taken.

    Attributes
    ----------
    index : int
        Place in the order of traversal; `id` is the caller's name for it.
    pose : Pose2
        map_from_base; changes when SLAM moves the node (`NodeGraph.move`).
    sector : (centre_rad, half_width_rad)
        What the scan looked at, about the base's x axis.
    bearings_rad, ranges_m : (B,) float64
        The scan, in the base's directions; NaN where nothing was read.
    came_from : int | None
        Index of the node the robot drove from.
    came_by_m : (N, 2) float64
        The way driven, densely, in the frame of `came_from`; empty when not known.
    way_m, home_m : float
        Lengths of `came_by_m`, and of the way home as it was known when the robot was here
        (inf: it was not).
    neighbours : dict
        Index of each neighbour, and the cost of the way there in metres.
    """

    index: int
    id: int
    stamp_s: float
    pose: Pose2
    sector: tuple[float, float]
    bearings_rad: FloatArray
    ranges_m: FloatArray
    gaps: list[Gap]
    came_from: int | None = None
    came_by_m: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    way_m: float = 0.0
    home_m: float = math.inf
    neighbours: dict[int, float] = field(default_factory=dict)

    @property
    def position_m(self) -> FloatArray:
        """(2,) in the map frame."""
        return np.array([self.pose.x_m, self.pose.y_m])

    def centroid_m(self, gap: Gap) -> FloatArray:
        """(2,) centroid of one of its gaps, map frame."""
        return self.pose.apply(gap.centroid_m[None]).reshape(2)

    def ends_m(self, gap: Gap) -> FloatArray:
        """(2, 2) ends of one of its gaps, map frame."""
        return self.pose.apply(gap.ends_m)

    def outward(self, gap: Gap) -> FloatArray:
        """(2,) direction through one of its gaps, map frame."""
        return Pose2(0.0, 0.0, self.pose.heading_rad).apply(gap.outward[None]).reshape(2)

    def range_towards_m(self, point_m: FloatArray) -> float:
        """What the scan read towards a point of the map; NaN where it did not look."""
        dx, dy = self.pose.inverse().apply(np.asarray(point_m)[None])[0]
        bearing = math.atan2(dy, dx)
        if len(self.bearings_rad) == 0:
            return math.nan
        off = np.abs(wrap_rad(self.bearings_rad - bearing))
        nearest = int(off.argmin())
        return float(self.ranges_m[nearest]) if off[nearest] < math.radians(3.0) else math.nan


class NodeGraph:
    """Nodes in the order of traversal."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._edges_m = np.zeros((64, 64))  # 0: no edge
        self._poses: FloatArray | None = _no_rows(3)  # asked for eight times a decision
        self._sectors = _no_rows(2)
        self._arrivals = _no_rows(2)  # from which node, by a way how long
        self._ways_m: dict[int, tuple[Pose2, FloatArray, FloatArray]] = {}

    def __len__(self) -> int:
        return len(self.nodes)

    def add(self, node: Node) -> None:
        """Append a node; its index must be the next one."""
        if node.index != len(self.nodes):
            raise StateError(f"node {node.id}: index {node.index}, next is {len(self.nodes)}")
        self.nodes.append(node)
        if self._poses is not None:
            self._poses = _with_row(self._poses, node.pose.as_array())
        self._sectors = _with_row(self._sectors, node.sector)
        self._arrivals = _with_row(self._arrivals, (node.came_from or 0, node.way_m))
        if len(self.nodes) > len(self._edges_m):
            grown = np.zeros((2 * len(self._edges_m),) * 2)
            grown[: len(self._edges_m), : len(self._edges_m)] = self._edges_m
            self._edges_m = grown

    def link(self, a: int, b: int, cost_m: float) -> None:
        """Make two nodes neighbours; the cheaper of two known ways counts."""
        cost_m = max(cost_m, EDGE_COST_MIN_M)
        self.nodes[a].neighbours[b] = min(cost_m, self.nodes[a].neighbours.get(b, math.inf))
        self.nodes[b].neighbours[a] = self.nodes[a].neighbours[b]
        self._edges_m[a, b] = self._edges_m[b, a] = self.nodes[a].neighbours[b]

    def move(self, index: int, pose: Pose2) -> None:
        """SLAM knows better where a node is."""
        if pose != self.nodes[index].pose:
            self.nodes[index].pose = pose
            self._poses = None

    def poses(self) -> FloatArray:
        """(K, 3) map frame; read-only."""
        if self._poses is None:
            poses = [(p.x_m, p.y_m, p.heading_rad) for p in (node.pose for node in self.nodes)]
            self._poses = np.array(poses, float).reshape(-1, 3)
            self._poses.flags.writeable = False
        return self._poses

    def positions_m(self) -> FloatArray:
        """(K, 2) map frame; read-only."""
        return self.poses()[:, :2]

    def sectors(self) -> FloatArray:
        """(K, 2) of the nodes, as `Node.sector`; read-only."""
        return self._sectors

    def driven_m(
        self, low_m: FloatArray | float = -math.inf, high_m: FloatArray | float = math.inf
    ) -> FloatArray:
        """(N, 2) places on the ways driven between nodes, map frame; as dense as stored.

        Those of ways that lead through a box from `low_m` (2,) to `high_m` (2,), and more.
        """
        reach_m = self._arrivals[:, 1:]
        from_m = self.positions_m()[self._arrivals[:, 0].astype(np.int64)]
        is_near = ((from_m + reach_m >= low_m) & (from_m - reach_m <= high_m)).all(axis=1)
        ways = [
            self._way_m(node, self.nodes[node.came_from].pose)
            for node in map(self.nodes.__getitem__, np.flatnonzero(is_near).tolist())
            if node.came_from is not None
        ]
        return np.concatenate([np.zeros((0, 2)), *ways])

    def _way_m(self, node: Node, origin: Pose2) -> FloatArray:
        """(N, 2) the way to a node, map frame; kept until its origin moves."""
        known = self._ways_m.get(node.index)
        if known is None or known[0] is not origin or known[1] is not node.came_by_m:
            known = origin, node.came_by_m, origin.apply(node.came_by_m)
            self._ways_m[node.index] = known
        return known[2]

    def costs_from(self, index: int) -> FloatArray:
        """(K,) travel cost from one node to each, through neighbours; inf where no way is."""
        return self._dijkstra(index)[0]

    def costs_between(self, indices: list[int]) -> FloatArray:
        """(N, N) travel costs among some nodes; inf where no way is."""
        count = len(self.nodes)
        costs: FloatArray = dijkstra(self._edges_m[:count, :count], indices=indices)
        return costs[:, indices]

    def way(self, start: int, goal: int) -> list[int]:
        """Nodes of the cheapest way, both ends included; empty when there is none."""
        costs, before = self._dijkstra(start)
        if not math.isfinite(costs[goal]):
            return []
        nodes = [goal]
        while nodes[-1] != start:
            nodes.append(int(before[nodes[-1]]))
        return nodes[::-1]

    def _dijkstra(self, index: int) -> tuple[FloatArray, np.ndarray]:
        count = len(self.nodes)
        edges = self._edges_m[:count, :count]
        distance, before = dijkstra(edges, indices=index, return_predecessors=True)
        return distance, before

    def gaps(self) -> Iterator[tuple[Node, Gap]]:
        """Every gap with its node."""
        for node in self.nodes:
            for gap in node.gaps:
                yield node, gap

    def as_json(self) -> dict[str, Any]:
        """JSON values only: `nodes`, each with `neighbours` (ids) and `gaps`, map frame."""
        return {"nodes": [self._node_json(node) for node in self.nodes]}

    def _node_json(self, node: Node) -> dict[str, Any]:
        centre, half = node.sector
        return {
            "id": node.id,
            "stamp_s": node.stamp_s,
            "x_m": node.pose.x_m,
            "y_m": node.pose.y_m,
            "heading_rad": node.pose.heading_rad,
            "sector": [centre - half, centre + half],
            "neighbours": [self.nodes[i].id for i in sorted(node.neighbours)],
            "gaps": [
                {
                    "id": gap.id,
                    "kind": str(gap.kind),
                    "centroid": [float(v) for v in node.centroid_m(gap)],
                    "ends": [[float(v) for v in end] for end in node.ends_m(gap)],
                    "width_m": gap.width_m,
                    "state": str(gap.state),
                    "why": gap.why,
                }
                for gap in node.gaps
            ],
        }


def _no_rows(width: int) -> FloatArray:
    return np.zeros((0, width))


def _with_row(rows: FloatArray, row: ArrayLike) -> FloatArray:
    """A copy, read-only, with one more row: who holds the old one keeps it."""
    longer = np.concatenate([rows, np.asarray(row, np.float64)[None]])
    longer.flags.writeable = False
    return longer
