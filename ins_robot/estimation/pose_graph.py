# SPDX-License-Identifier: MIT
"""Pose graph: nodes and relative poses between them in, relaxed node poses out.

Sparse Gauss-Newton (Lu & Milios 1997; Grisetti et al. 2010), the first node held. Closures
fade by dynamic covariance scaling (Agarwal et al. 2013) when they disagree with all the rest. A
graph whose edges already agree is left exactly as it was.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import between
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray

POSE_SIZE = 3
ITERATIONS = 6
CONVERGED_M = 1e-4
CONSISTENT_CHI2 = 1e-12
FADE_CHI2 = 25.0  # a closure off by more than this fades


class PoseGraph:
    """Node poses (K, 3) in the map frame and edges between them."""

    def __init__(self) -> None:
        self._poses = np.zeros((16, 3))
        self._count = 0
        self._from: list[int] = []
        self._to: list[int] = []
        self._measured: list[FloatArray] = []
        self._information: list[FloatArray] = []
        self._is_closure: list[bool] = []
        self._neighbours: list[set[int]] = []

    def __len__(self) -> int:
        return self._count

    @property
    def poses(self) -> FloatArray:
        """(K, 3) view of the node poses."""
        return self._poses[: self._count]

    @property
    def edge_count(self) -> int:
        """Number of edges."""
        return len(self._from)

    def add_node(self, pose: FloatArray) -> int:
        """Add a node; returns its index."""
        if self._count == len(self._poses):
            self._poses = np.concatenate([self._poses, np.zeros_like(self._poses)])
        self._poses[self._count] = pose
        self._count += 1
        self._neighbours.append(set())
        return self._count - 1

    def add_edge(
        self,
        start: int,
        end: int,
        start_from_end: FloatArray,
        information: FloatArray,
        is_closure: bool = False,
    ) -> None:
        """Say that `end` is at `start_from_end` (3,); information (3, 3) in `start`'s frame."""
        self._from.append(start)
        self._to.append(end)
        self._measured.append(start_from_end)
        self._information.append(information)
        self._is_closure.append(is_closure)
        self._neighbours[start].add(end)
        self._neighbours[end].add(start)

    def linked(self, starts: list[int], is_near: BoolArray) -> list[int]:
        """Near nodes reached over edges from the near ones of `starts`, fewest edges first."""
        queue = [node for node in starts if is_near[node]]
        seen = set(queue)
        for node in queue:
            for other in sorted(self._neighbours[node]):
                if other not in seen and is_near[other]:
                    seen.add(other)
                    queue.append(other)
        return queue

    def relax(self) -> FloatArray:
        """Move the nodes to where all edges agree best; (K,) metres that each went."""
        before = self.poses.copy()
        if not self._from:
            return np.zeros(self._count)
        start, end = np.array(self._from), np.array(self._to)
        measured = np.array(self._measured)
        information = np.array(self._information)
        is_closure = np.array(self._is_closure)
        for _ in range(ITERATIONS):
            step = self._solve(start, end, measured, information, is_closure)
            self.poses[:] += step
            self.poses[:, 2] = wrap_rad(self.poses[:, 2])
            if np.abs(step).max() < CONVERGED_M:
                break
        return np.asarray(np.hypot(*(self.poses - before)[:, :2].T))

    def _solve(
        self,
        start: IntArray,
        end: IntArray,
        measured: FloatArray,
        information: FloatArray,
        is_closure: BoolArray,
    ) -> FloatArray:
        """(K, 3) Gauss-Newton step; zero where the graph agrees."""
        a, b = self.poses[start], self.poses[end]
        error = between(a, b) - measured  # in the start's frame
        error[:, 2] = wrap_rad(error[:, 2])
        chi2 = np.einsum("ei,eij,ej->e", error, information, error)
        if chi2.max() < CONSISTENT_CHI2:
            return np.zeros_like(self.poses)
        faded = _fade(chi2, is_closure)
        weighted = information * (faded**2)[:, None, None]
        c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        by_end = np.zeros((len(a), 3, 3))
        by_end[:, 0, 0], by_end[:, 0, 1], by_end[:, 1, 0], by_end[:, 1, 1] = c, s, -s, c
        by_end[:, 2, 2] = 1.0
        by_start = -by_end
        by_start[:, 0, 2] = -s * dx + c * dy
        by_start[:, 1, 2] = -c * dx - s * dy
        blocks, gradient = [], np.zeros((self._count, 3))
        for row, row_jacobian in ((start, by_start), (end, by_end)):
            left = np.swapaxes(row_jacobian, 1, 2) @ weighted
            np.add.at(gradient, row, (left @ error[..., None])[..., 0])
            blocks += [
                (row, col, left @ jacobian)
                for col, jacobian in ((start, by_start), (end, by_end))
            ]
        axis = np.arange(3)
        rows = np.concatenate(
            [
                np.broadcast_to(r[:, None, None] * 3 + axis[:, None], v.shape).ravel()
                for r, _, v in blocks
            ]
        )
        cols = np.concatenate(
            [
                np.broadcast_to(k[:, None, None] * 3 + axis, v.shape).ravel()
                for _, k, v in blocks
            ]
        )
        values = np.concatenate([v.ravel() for _, _, v in blocks])
        free = (rows >= POSE_SIZE) & (cols >= POSE_SIZE)  # node 0 is held
        size = 3 * self._count - 3
        matrix = csc_matrix(
            (values[free], (rows[free] - 3, cols[free] - 3)), shape=(size, size)
        )
        matrix.setdiag(matrix.diagonal() + 1e-9)
        step = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
            -gradient.reshape(-1)[3:]
        )
        return np.concatenate([np.zeros(3), step]).reshape(-1, 3)


def _fade(chi2: FloatArray, is_closure: BoolArray) -> FloatArray:
    """(E,) factor on each edge's error: 1, falling for closures that disagree with the rest."""
    return np.where(is_closure, np.minimum(1.0, 2.0 * FADE_CHI2 / (FADE_CHI2 + chi2)), 1.0)


def heading_rotation(heading_rad: float) -> FloatArray:
    """(3, 3) that turns map-frame errors (x, y, heading) into a frame with that heading."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
