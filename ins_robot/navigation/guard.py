# SPDX-License-Identifier: MIT
"""The visibility guard: gaps are explored when the map says so, and only then.

`SeenGuard` asks the map: a gap from which nothing unseen shows is explored without a visit, and
edges of the seen part that no gap leads to become gaps of the nearest node, so that exploration
is complete. `NoGuard` has the same methods and believes the paper's rules: a gap is explored by
a scan near it, or by rule B.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import Gap, GapKind, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.sight import sees
from ins_robot.navigation.unseen import IndexArray, Unseen, pieces

EDGE_SIGHT_M = 0.5  # an edge gap leads to what is this near to its middle, or to its ends
PIECE_M = 2.0  # longer edges become several gaps
NODE_SIGHT_TRIES = 5  # nearest nodes that are asked whether they see an edge
SCANNED_M = 0.5  # without the guard: a gap this near to a later scan's place was seen through


class Guard(Protocol):
    """What the explorer asks about gaps."""

    def targets_m(self, unseen: Unseen, graph: NodeGraph, node: Node, gap: Gap) -> FloatArray:
        """(T, 2) what a scan at the gap should show; nothing left: the gap is explored."""

    def adopt_edges(self, unseen: Unseen, graph: NodeGraph, led_to: set[int]) -> int:
        """Make gaps of the edges that no gap leads to; returns how many."""


class SeenGuard:
    """The map decides."""

    def targets_m(self, unseen: Unseen, graph: NodeGraph, node: Node, gap: Gap) -> FloatArray:
        """(T, 2) unseen ground in view from the gap: what a scan there should show; map frame.

        None left: the gap is explored.
        """
        return unseen.ahead_m[edges_of_gap(unseen, node, gap)]

    def adopt_edges(self, unseen: Unseen, graph: NodeGraph, led_to: set[int]) -> int:
        """Make gaps of the edges no gap leads to; returns how many."""
        count = 0
        for edge in sorted(set(unseen.edge_of.tolist()) - led_to):
            for piece in pieces(unseen, edge, PIECE_M):
                gap_along(unseen, graph, piece)
                count += 1
        return count


class NoGuard:
    """The paper's rules as printed."""

    def targets_m(self, unseen: Unseen, graph: NodeGraph, node: Node, gap: Gap) -> FloatArray:
        """(1, 2) the centroid; (0, 2) once a scan was taken there, be it for another gap."""
        centroid = node.centroid_m(gap)
        away = graph.positions_m() - centroid
        is_scanned = bool((np.hypot(away[:, 0], away[:, 1]) < SCANNED_M).any())
        return np.zeros((0, 2)) if is_scanned else centroid[None]

    def adopt_edges(self, unseen: Unseen, graph: NodeGraph, led_to: set[int]) -> int:
        """The paper knows no edges."""
        return 0


def edges_of_gap(unseen: Unseen, node: Node, gap: Gap) -> IndexArray:
    """Indices of the edge cells that show from a gap: from its middle and both halves."""
    ends, middle = node.ends_m(gap), node.centroid_m(gap)
    if gap.kind is GapKind.EDGE:
        sight = max(EDGE_SIGHT_M, 0.5 * gap.width_m)
        return unseen.showing_from(middle[None], middle, None, sight)
    places = np.stack([middle, 0.5 * (middle + ends[0]), 0.5 * (middle + ends[1])])
    return unseen.showing_from(places, middle, node.outward(gap))


def gap_along(unseen: Unseen, graph: NodeGraph, index: IndexArray) -> tuple[Node, Gap]:
    """Make a gap of some edge cells, by index; it becomes the nearest node's."""
    points = unseen.points_m[index]
    middle = points[int(np.hypot(*(points - points.mean(axis=0)).T).argmin())]
    node = _nearest_node(unseen, graph, middle)
    outward = (unseen.ahead_m[index] - points).mean(axis=0)
    gap = _edge_gap(node, points, middle, outward)
    node.gaps.append(gap)
    return node, gap


def _nearest_node(unseen: Unseen, graph: NodeGraph, point_m: FloatArray) -> Node:
    """The nearest node that sees the point, else the nearest."""
    positions = graph.positions_m()
    order = np.argsort(np.hypot(*(positions - point_m).T), kind="stable")
    origin, resolution = np.array(unseen.grid.origin_m), unseen.grid.resolution_m
    asked = order[:NODE_SIGHT_TRIES]
    seen = sees(
        unseen.is_opaque,
        (positions[asked] - origin)[:, ::-1] / resolution,
        (point_m - origin)[None, ::-1] / resolution,
    )[:, 0]
    return graph.nodes[int(asked[seen][0] if seen.any() else order[0])]


def _edge_gap(
    node: Node, points_m: FloatArray, middle_m: FloatArray, towards_m: FloatArray
) -> Gap:
    """A gap along a piece of edge: its ends lie as far apart as the piece is long."""
    local = node.pose.inverse().apply(points_m)
    middle = node.pose.inverse().apply(middle_m[None])[0]
    spread = local - local.mean(axis=0)
    axis = np.linalg.eigh(spread.T @ spread)[1][:, -1]
    along = spread @ axis
    half = 0.5 * float(along.max() - along.min())
    outward = np.array([-axis[1], axis[0]])
    towards = Pose2(0.0, 0.0, -node.pose.heading_rad).apply(towards_m[None]).reshape(2)
    if float(outward @ towards) < 0.0:
        outward = -outward
    return Gap(
        id=len(node.gaps),
        ends_m=np.stack([middle - half * axis, middle + half * axis]),
        outward=outward,
        kind=GapKind.EDGE,
        state=GapState.UNEXPLORED,
        why="edge of the seen part of the map",
    )
