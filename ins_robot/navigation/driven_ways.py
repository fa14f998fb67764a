# SPDX-License-Identifier: MIT
"""Memory of the ways driven: decisions, nodes and failures in, each node's way of arrival out.

The ways make the order of traversal (`Node.came_from`, `Node.came_by_m`) and tell what ground
is surely drivable. A way retraced over earlier nodes counts from the node at which it ends.
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.planner import dense_points_m

STEP_M = 0.04  # spacing of what is remembered


class DrivenWays:
    """Ways since the last node, and those between the nodes of a graph."""

    def __init__(self, graph: NodeGraph) -> None:
        self._graph = graph
        self._since_node_m: list[FloatArray] = []
        self._unfinished_m: FloatArray | None = None

    def gave_up(self, path_m: FloatArray) -> None:
        """The robot left a path (N, 2) somewhere; `stands_at` will tell where."""
        self._unfinished_m = path_m

    def stands_at(self, pose: Pose2) -> None:
        """Where the robot is when it decides anew."""
        if self._unfinished_m is not None:
            self._add(self._unfinished_m, np.array([pose.x_m, pose.y_m]))
            self._unfinished_m = None

    def arrived(self, node: Node, path_m: FloatArray, retraced_to: Node | None) -> None:
        """A path (N, 2) led to a new node; `retraced_to`: over the way back to that node."""
        self._add(path_m, node.position_m)
        way_m = np.concatenate(self._since_node_m)
        if retraced_to is not None:
            away_m = way_m - retraced_to.position_m
            nearest = len(way_m) - 1 - int(np.hypot(*away_m[::-1].T).argmin())
            node.came_from, way_m = retraced_to.index, way_m[nearest:]
        if node.came_from is not None:
            origin = self._graph.nodes[node.came_from].pose
            node.came_by_m = origin.inverse().apply(way_m)
            node.way_m = float(np.hypot(*np.diff(node.came_by_m, axis=0).T).sum())
            node.home_m = self._graph.nodes[node.came_from].home_m + node.way_m
        self._since_node_m.clear()

    def interrupted(self) -> None:
        """The robot was carried: no way leads to where it goes on."""
        self._since_node_m.clear()

    def places_m(self, low_m: FloatArray, high_m: FloatArray) -> FloatArray:
        """(N, 2) all places driven through in a box, and more; densely, map frame."""
        return np.concatenate([self._graph.driven_m(low_m, high_m), *self._since_node_m])

    def _add(self, path_m: FloatArray, until_m: FloatArray) -> None:
        """Note a path as driven up to its place nearest to where the robot is."""
        points = dense_points_m(path_m, STEP_M)
        away = points - until_m
        self._since_node_m.append(points[: int(np.hypot(away[:, 0], away[:, 1]).argmin()) + 1])
