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

from ins_robot.estimation.growing_rows import GrowingRows
from ins_robot.estimation.pose_graph import PoseGraph, heading_rotations
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
SECTORS = 180  # of what a scan saw around it
PAST_M = 0.3  # a point this far before all that a scan saw there was not there
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
        self._travelled_m = GrowingRows(())
        self._last = GrowingRows((), np.int64)  # surfels of node k end there
        # metres from the node: single precision is a micrometre
        self._points = GrowingRows((2,), np.float32)
        self._normals = GrowingRows((2,), np.float32)
        self._is_flat = GrowingRows((), np.bool_)
        self._std = GrowingRows((), np.float32)
        self._tilt = GrowingRows((), np.float32)

    def __len__(self) -> int:
        return len(self.graph)

    @property
    def travelled_m(self) -> FloatArray:
        """(K,) way driven when each node was made."""
        return self._travelled_m.all

    def add(
        self, pose: FloatArray, scan: LaserScan, surfels: Surfels, travelled_m: float
    ) -> int:
        """Keep a scan with its surfels (base frame) at a pose (3,); returns the node's id."""
        surfels = surfels.take(~surfels.is_lone)
        node = self.graph.add_node(pose)
        self.scans.append(scan)
        self._travelled_m.add(travelled_m)
        self._points.extend(surfels.points_m)
        self._normals.extend(surfels.normals)
        self._is_flat.extend(surfels.is_flat)
        self._std.extend(surfels.std_m)
        self._tilt.extend(surfels.tilt_std_rad)
        self._last.add(len(self._points))
        return node

    def link_motion(
        self, start: int, end: int, motion: MotionIncrement, is_matched: bool
    ) -> None:
        """Odometry edge between consecutive nodes; a match has used the odometry up already."""
        worth = MATCHED_ODOMETRY_WORTH if is_matched else 1.0
        information = np.asarray(np.linalg.inv(motion.covariance + MOTION_VARIANCE_MIN), float)
        self.graph.add_edge(
            start, end, motion.delta.as_array(), worth * information, is_motion=True
        )

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
            turn = heading_rotations(at_source[None, 2])[0]
            self.graph.add_edge(
                source, node, between(at_source, pose), turn @ information @ turn.T, is_closure
            )

    def surfels(self, node: int) -> Surfels:
        """What a node's scan shows, base frame, but for what is lone."""
        rows, _ = self._rows(np.array([node]))
        return Surfels(
            points_m=self._points.all.take(rows, axis=0).astype(np.float64),
            normals=self._normals.all.take(rows, axis=0).astype(np.float64),
            is_flat=self._is_flat.all.take(rows),
            std_m=self._std.all.take(rows).astype(np.float64),
            tilt_std_rad=self._tilt.all.take(rows).astype(np.float64),
            is_lone=np.zeros(len(rows), dtype=bool),
            sources=np.full(len(rows), node),
        )

    def near(self, position: FloatArray, radius_m: float) -> BoolArray:
        """(K,) bool: nodes within that distance of (x, y)."""
        x, y = self.graph.poses[:, 0] - position[0], self.graph.poses[:, 1] - position[1]
        return np.asarray(x * x + y * y < radius_m**2)

    def linked(self, starts: IntArray, pose: FloatArray) -> IntArray:
        """Nodes near `pose` linked to those of `starts` without leaving the neighbourhood."""
        return self.graph.linked(starts, self.near(pose, LINK_RADIUS_M))

    def nearest(self, nodes: IntArray, pose: FloatArray) -> int:
        """The one of `nodes` nearest to `pose`."""
        off = self.graph.poses[nodes, :2] - pose[:2]
        return int(nodes[np.argmin((off**2).sum(axis=1))])

    def local_field(self, nodes: IntArray, pose: FloatArray) -> LikelihoodField | None:
        """What the nearest of `nodes` saw around `pose`, from the side the robot is on."""
        if not len(nodes):
            return None
        off = self.graph.poses[nodes, :2] - pose[:2]
        square = (off**2).sum(axis=1)
        if len(nodes) > LOCAL_NODES:
            nodes = nodes[np.argpartition(square, LOCAL_NODES)[:LOCAL_NODES]]
        surfels = self._seen_around(np.sort(nodes), pose)
        return LikelihoodField(surfels) if len(surfels) else None

    def seen_past(self, nodes: IntArray, points_m: FloatArray) -> BoolArray:
        """(N,) bool: points (N, 2), map frame, which a scan of `nodes` saw past: not there.

        Seen from the base: an LRF far from its middle is told a little wrong nearby.
        """
        rows, counts = self._rows(nodes)
        sectors, range_m = _polar(self._points.all.take(rows, axis=0))
        horizon_m = np.full((len(nodes), SECTORS), np.inf)
        np.minimum.at(horizon_m, (np.repeat(np.arange(len(nodes)), counts), sectors), range_m)
        beside_m = np.minimum(np.roll(horizon_m, 1, axis=1), np.roll(horizon_m, -1, axis=1))
        horizon_m = np.where(np.isinf(horizon_m), 0.0, np.minimum(horizon_m, beside_m))
        off_m = points_m - self.graph.poses[nodes, None, :2]
        sectors, range_m = _polar(off_m, self.graph.poses[nodes, None, 2])
        ends_m = np.take_along_axis(horizon_m, sectors, axis=1)
        return np.asarray((range_m < ends_m - PAST_M).any(axis=0))

    def _seen_around(self, nodes: IntArray, pose: FloatArray) -> Surfels:
        """Surfels of those nodes, map frame: near `pose`, and not seen from behind there."""
        rows, counts = self._rows(nodes)
        node_x, node_y, heading = (np.repeat(p, counts) for p in self.graph.poses[nodes].T)
        c, s = np.cos(heading), np.sin(heading)
        x, y = _turned(c, s, self._points.all.take(rows, axis=0))
        nx, ny = _turned(c, s, self._normals.all.take(rows, axis=0))
        x += node_x
        y += node_y
        off_x, off_y = x - pose[0], y - pose[1]
        is_flat = self._is_flat.all.take(rows)
        in_front = nx * off_x + ny * off_y < BEHIND_M
        is_near = off_x**2 + off_y**2 < MATCH_RADIUS_M**2
        kept = np.flatnonzero((in_front | ~is_flat) & is_near)
        rows = rows.take(kept)
        return Surfels(
            points_m=np.stack([x.take(kept), y.take(kept)], axis=-1),
            normals=np.stack([nx.take(kept), ny.take(kept)], axis=-1),
            is_flat=is_flat.take(kept),
            std_m=self._std.all.take(rows).astype(np.float64),
            tilt_std_rad=self._tilt.all.take(rows).astype(np.float64),
            is_lone=np.zeros(len(rows), dtype=bool),
            sources=np.repeat(nodes, counts).take(kept),
        )

    def _rows(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """(N,) rows of those nodes' surfels, node by node; and how many each has."""
        last = self._last.all
        first = np.where(nodes > 0, last[nodes - 1], 0)
        counts = last[nodes] - first
        ahead = np.cumsum(counts) - counts
        return np.arange(counts.sum()) + np.repeat(first - ahead, counts), counts


def _turned(c: FloatArray, s: FloatArray, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) x and y of vectors (N, 2), turned by the headings with that cosine and sine."""
    x, y = vectors.T
    return c * x - s * y, s * x + c * y


def _polar(
    points_m: FloatArray, heading_rad: FloatArray | float = 0.0
) -> tuple[IntArray, FloatArray]:
    """Sector of the horizon and range of points (..., 2) seen with a heading."""
    x, y = points_m[..., 0], points_m[..., 1]
    turns = (np.arctan2(y, x) - heading_rad) / (2.0 * np.pi)
    return np.floor(SECTORS * turns).astype(np.int64) % SECTORS, np.hypot(x, y)


def way_m(motion: MotionIncrement) -> float:
    """Length of an increment."""
    return math.hypot(motion.delta.x_m, motion.delta.y_m)
