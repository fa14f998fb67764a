# SPDX-License-Identifier: MIT
"""The map as nodes: scans at poses that a graph may still move; local maps are drawn from them.

Surfels of all nodes lie in one store, each in its node's frame, never copied: a moved node
takes its scan along by moving its pose. What is *linked* to a node over edges nearby agrees
with it and may be matched against; what is near but not linked is the far end of a loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ins_robot.estimation.pose_graph import PoseGraph, heading_rotation
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray
from ins_robot.mapping.surfels import Surfels
from ins_robot.messages import LaserScan, MotionIncrement

LINK_RADIUS_M = 8.0  # nodes this near may share what they see
LOCAL_NODES = 30
MATCH_RADIUS_M = 12.0  # what is further from the robot is left out of a local map
EDGES_PER_NODE = 4
SURFEL_SPACING_M = 0.03
MATCHED_ODOMETRY_WORTH = 0.01
MOTION_VARIANCE_MIN = np.diag([1e-6, 1e-6, 1e-7])
BEHIND_M = 0.15  # surfaces seen from behind by more than this are the other side of a wall


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A place where a scan was kept; `pose` is map_from_base as corrected so far."""

    id: int
    stamp_s: float
    pose: Pose2
    scan: LaserScan


class NodeMap:
    """Nodes, their scans and surfels, and the graph that holds their poses."""

    def __init__(self) -> None:
        self.graph = PoseGraph()
        self.scans: list[LaserScan] = []
        self.travelled_m: list[float] = []  # way driven when each node was made
        self._bounds = [0]  # surfels of node k are [bounds[k], bounds[k + 1])
        self._points = np.zeros((1024, 2))
        self._normals = np.zeros((1024, 2))
        self._is_flat = np.zeros(1024, dtype=bool)
        self._std = np.zeros(1024)
        self._tilt = np.zeros(1024)
        self._sources = np.zeros(1024, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.graph)

    def add(
        self, pose: FloatArray, scan: LaserScan, surfels: Surfels, travelled_m: float
    ) -> int:
        """Keep a scan with its surfels (base frame) at a pose (3,); returns the node's id."""
        surfels = surfels.take(~surfels.is_lone)
        node = self.graph.add_node(pose)
        self.scans.append(scan)
        self.travelled_m.append(travelled_m)
        first, last = self._bounds[-1], self._bounds[-1] + len(surfels)
        while last > len(self._points):
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
            self._normals = np.concatenate([self._normals, np.zeros_like(self._normals)])
            self._is_flat = np.concatenate([self._is_flat, np.zeros_like(self._is_flat)])
            self._std = np.concatenate([self._std, np.zeros_like(self._std)])
            self._tilt = np.concatenate([self._tilt, np.zeros_like(self._tilt)])
            self._sources = np.concatenate([self._sources, np.zeros_like(self._sources)])
        part = slice(first, last)
        self._points[part], self._normals[part] = surfels.points_m, surfels.normals
        self._is_flat[part], self._std[part] = surfels.is_flat, surfels.std_m
        self._tilt[part] = surfels.tilt_std_rad
        self._sources[part] = node
        self._bounds.append(last)
        return node

    def link_motion(
        self, start: int, end: int, motion: MotionIncrement, is_matched: bool
    ) -> None:
        """Odometry edge between consecutive nodes; a match has used the odometry up already."""
        worth = MATCHED_ODOMETRY_WORTH if is_matched else 1.0
        information = np.asarray(np.linalg.inv(motion.covariance + MOTION_VARIANCE_MIN), float)
        self.graph.add_edge(start, end, motion.delta.as_array(), worth * information)

    def link_match(
        self, node: int, pose: FloatArray, match: Alignment, is_closure: bool = False
    ) -> None:
        """Edges from the nodes whose surfels the scan lay on, each with its own information."""
        by_weight = sorted(
            (
                (float(np.trace(h[:2, :2])), k, h)
                for k, h in match.by_source.items()
                if k != node
            ),
            key=lambda entry: (-entry[0], entry[1]),
        )
        for _, source, information in by_weight[:EDGES_PER_NODE]:
            at_source = self.graph.poses[source]
            turn = heading_rotation(float(at_source[2]))
            self.graph.add_edge(
                source, node, between(at_source, pose), turn @ information @ turn.T, is_closure
            )

    def near(self, position: FloatArray, radius_m: float) -> BoolArray:
        """(K,) bool: nodes within that distance of (x, y)."""
        off = self.graph.poses[:, :2] - position[:2]
        return np.asarray((off**2).sum(axis=1) < radius_m**2)

    def linked(self, starts: list[int], pose: FloatArray) -> list[int]:
        """Nodes near `pose` linked to those of `starts` without leaving the neighbourhood."""
        return self.graph.linked(starts, self.near(pose, LINK_RADIUS_M))

    def nearest(self, nodes: list[int], pose: FloatArray) -> int:
        """The one of `nodes` nearest to `pose`."""
        off = self.graph.poses[nodes, :2] - pose[:2]
        return nodes[int(np.argmin((off**2).sum(axis=1)))]

    def local_field(self, nodes: list[int], pose: FloatArray) -> LikelihoodField | None:
        """What the nearest of `nodes` saw around `pose`, from the side the robot is on."""
        if not nodes:
            return None
        index = np.array(nodes)
        off = self.graph.poses[index, :2] - pose[:2]
        nearest = np.argsort((off**2).sum(axis=1), kind="stable")[:LOCAL_NODES]
        surfels = self._gather(np.sort(index[nearest]))
        offset = surfels.points_m - pose[:2]
        in_front = (surfels.normals * offset).sum(axis=1) < BEHIND_M
        keep = (in_front | ~surfels.is_flat) & ((offset**2).sum(axis=1) < MATCH_RADIUS_M**2)
        if not keep.any():
            return None
        return LikelihoodField(surfels.take(keep))

    def _gather(self, nodes: IntArray) -> Surfels:
        """Surfels of those nodes, in the map frame, in one go."""
        rows = np.concatenate([np.arange(self._bounds[k], self._bounds[k + 1]) for k in nodes])
        sources = self._sources[rows]
        poses = self.graph.poses[sources]
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])

        def turn(v: FloatArray) -> FloatArray:
            return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]], axis=-1)

        return Surfels(
            points_m=turn(self._points[rows]) + poses[:, :2],
            normals=turn(self._normals[rows]),
            is_flat=self._is_flat[rows],
            std_m=self._std[rows],
            tilt_std_rad=self._tilt[rows],
            is_lone=np.zeros(len(rows), dtype=bool),
            sources=sources,
        )


def way_m(motion: MotionIncrement) -> float:
    """Length of an increment."""
    return math.hypot(motion.delta.x_m, motion.delta.y_m)
