# SPDX-License-Identifier: MIT
"""Pose graph: nodes and what is known between them in, relaxed node poses out.

Sparse Gauss-Newton (Lu & Milios 1997; Grisetti et al. 2010), the first node held. Closures
and sights fade by dynamic covariance scaling (Agarwal et al. 2013) when they disagree with all
the rest. A graph whose edges already agree is left exactly as it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
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
    """Node poses (K, 3) in the map frame, edges between them, and directions they share."""

    def __init__(self) -> None:
        self._poses = np.zeros((16, 3))
        self._count = 0
        self._from: list[int] = []
        self._to: list[int] = []
        self._measured: list[FloatArray] = []
        self._information: list[FloatArray] = []
        self._is_closure: list[bool] = []
        self._neighbours: list[set[int]] = []
        self._directions_rad = np.zeros(0)
        self._sights: list[tuple[int, int]] = []
        self._turned_rad: list[float] = []
        self._sight_weights: list[float] = []

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

    @property
    def directions_rad(self) -> FloatArray:
        """(D,) headings, map frame, of the directions that nodes see."""
        return self._directions_rad

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

    def add_direction(self, heading_rad: float) -> int:
        """Add a direction of unknown heading, beginning with this one; returns its index."""
        self._directions_rad = np.append(self._directions_rad, heading_rad)
        return len(self._directions_rad) - 1

    def add_sight(self, node: int, direction: int, turned_rad: float, std_rad: float) -> None:
        """Say that a node's heading is `turned_rad` from a direction's."""
        self._sights.append((node, direction))
        self._turned_rad.append(turned_rad)
        self._sight_weights.append(1.0 / std_rad**2)

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
        """Move the nodes to where all agrees best; (K,) metres that each went."""
        before = self.poses.copy()
        if not self._from:
            return np.zeros(self._count)
        start, end = np.array(self._from), np.array(self._to)
        measured = np.array(self._measured)
        information = np.array(self._information)
        is_closure = np.array(self._is_closure)
        for _ in range(ITERATIONS):
            step = self._solve(start, end, measured, information, is_closure)
            self.poses[:] += step[: POSE_SIZE * self._count].reshape(-1, POSE_SIZE)
            self.poses[:, 2] = wrap_rad(self.poses[:, 2])
            self._directions_rad = self._directions_rad + step[POSE_SIZE * self._count :]
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
        """(3 K + D,) Gauss-Newton step, poses then directions; zero where the graph agrees."""
        a, b = self.poses[start], self.poses[end]
        error = between(a, b) - measured  # in the start's frame
        error[:, 2] = wrap_rad(error[:, 2])
        chi2 = np.einsum("ei,eij,ej->e", error, information, error)
        sights = self._sight_equations()
        size = POSE_SIZE * self._count + len(self._directions_rad)
        if max(chi2.max(), sights.chi2_max) < CONSISTENT_CHI2:
            return np.zeros(size)
        faded = np.where(is_closure, _fade(chi2), 1.0)
        weighted = information * (faded**2)[:, None, None]
        c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        by_end = np.zeros((len(a), 3, 3))
        by_end[:, 0, 0], by_end[:, 0, 1], by_end[:, 1, 0], by_end[:, 1, 1] = c, s, -s, c
        by_end[:, 2, 2] = 1.0
        by_start = -by_end
        by_start[:, 0, 2] = -s * dx + c * dy
        by_start[:, 1, 2] = -c * dx - s * dy
        blocks, by_node = [], np.zeros((self._count, POSE_SIZE))
        for row, row_jacobian in ((start, by_start), (end, by_end)):
            left = np.swapaxes(row_jacobian, 1, 2) @ weighted
            np.add.at(by_node, row, (left @ error[..., None])[..., 0])
            blocks += [
                (row, col, left @ jacobian)
                for col, jacobian in ((start, by_start), (end, by_end))
            ]
        axis = np.arange(POSE_SIZE)
        rows = [_spread(POSE_SIZE * r[:, None, None] + axis[:, None], v) for r, _, v in blocks]
        cols = [_spread(POSE_SIZE * k[:, None, None] + axis, v) for _, k, v in blocks]
        matrix = coo_matrix(
            (
                np.concatenate([*(v.ravel() for _, _, v in blocks), sights.values]),
                (
                    np.concatenate([*rows, sights.rows]),
                    np.concatenate([*cols, sights.cols]),
                ),
            ),
            shape=(size, size),
        ).tocsc()[POSE_SIZE:, POSE_SIZE:]  # node 0 is held
        gradient = np.concatenate([by_node.ravel(), np.zeros(len(self._directions_rad))])
        gradient += sights.gradient
        matrix.setdiag(matrix.diagonal() + 1e-9)
        step = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
            -gradient[POSE_SIZE:]
        )
        return np.concatenate([np.zeros(POSE_SIZE), step])

    def _sight_equations(self) -> _SightEquations:
        """What the shared directions add to the normal equations."""
        size = POSE_SIZE * self._count + len(self._directions_rad)
        seen = np.array(self._sights, dtype=np.int64).reshape(-1, 2)
        heading = POSE_SIZE * seen[:, 0] + 2
        direction = POSE_SIZE * self._count + seen[:, 1]
        off = wrap_rad(
            self.poses[seen[:, 0], 2]
            - self._directions_rad[seen[:, 1]]
            - np.array(self._turned_rad)
        )
        weights = np.array(self._sight_weights)
        chi2 = weights * off**2
        weights = weights * _fade(chi2) ** 2
        pull = np.bincount(heading, weights * off, size).astype(np.float64)
        pull -= np.bincount(direction, weights * off, size)
        return _SightEquations(
            rows=np.concatenate([heading, heading, direction, direction]),
            cols=np.concatenate([heading, direction, heading, direction]),
            values=np.concatenate([weights, -weights, -weights, weights]),
            gradient=pull,
            chi2_max=float(chi2.max(initial=0.0)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _SightEquations:
    """Sparse entries of the normal equations, and the gradient (3 K + D,)."""

    rows: IntArray
    cols: IntArray
    values: FloatArray
    gradient: FloatArray
    chi2_max: float


def _spread(index: IntArray, values: FloatArray) -> IntArray:
    return np.broadcast_to(index, values.shape).ravel()


def _fade(chi2: FloatArray) -> FloatArray:
    """(E,) factor on each error: 1, falling for those that disagree with the rest."""
    return np.asarray(np.minimum(1.0, 2.0 * FADE_CHI2 / (FADE_CHI2 + chi2)))


def heading_rotation(heading_rad: float) -> FloatArray:
    """(3, 3) that turns map-frame errors (x, y, heading) into a frame with that heading."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
