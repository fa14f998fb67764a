# SPDX-License-Identifier: MIT
"""Pose graph: nodes and what is known between them in, relaxed node poses out.

A graph whose edges already agree is left exactly as it was, and of one in which something new
disagrees only what that moves is touched (`relaxation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ins_robot.estimation.growing_rows import GrowingRows
from ins_robot.estimation.relaxation import Constraints, State, relax
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import between
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A graph as it was: its state, and how many edges and sights it had."""

    state: State
    edges: int
    sights: int
    relaxed: tuple[int, int, int]


class PoseGraph:
    """Node poses (K, 3) in the map frame, edges between them, and directions they share."""

    def __init__(self) -> None:
        self._poses = GrowingRows((3,))
        self._ends = GrowingRows((2,), np.int32)
        self._measured = GrowingRows((3,))
        self._information = GrowingRows((3, 3))
        self._is_closure = GrowingRows((), np.bool_)
        self._is_motion = GrowingRows((), np.bool_)
        self._directions_rad = np.zeros(0)
        self._sights = GrowingRows((2,), np.int32)
        self._turned_rad = GrowingRows(())
        self._sight_weights = GrowingRows(())
        self._strain = GrowingRows((3,))  # what pulls at nodes that were held
        self._relaxed = (0, 0, 0)  # nodes, edges and sights that the poses agree with

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses(self) -> FloatArray:
        """(K, 3) view of the node poses."""
        return self._poses.all

    @property
    def edge_count(self) -> int:
        """Number of edges."""
        return len(self._ends)

    @property
    def directions_rad(self) -> FloatArray:
        """(D,) headings, map frame, of the directions that nodes see."""
        return self._directions_rad

    def add_node(self, pose: FloatArray) -> int:
        """Add a node; returns its index."""
        self._poses.add(pose)
        self._strain.add(np.zeros(3))
        return len(self) - 1

    def add_edge(
        self,
        start: int,
        end: int,
        start_from_end: FloatArray,
        information: FloatArray,
        is_closure: bool = False,
        is_motion: bool = False,
    ) -> None:
        """Say that `end` is at `start_from_end` (3,); information (3, 3) in `start`'s frame.

        By a motion from there to there, or by what was seen; if so, perhaps to close a loop.
        """
        self._ends.add((start, end))
        self._measured.add(start_from_end)
        self._information.add(information)
        self._is_closure.add(is_closure)
        self._is_motion.add(is_motion)

    def add_direction(self, heading_rad: float) -> int:
        """Add a direction of unknown heading, beginning with this one; returns its index."""
        self._directions_rad = np.append(self._directions_rad, heading_rad)
        return len(self._directions_rad) - 1

    def add_sight(self, node: int, direction: int, turned_rad: float, std_rad: float) -> None:
        """Say that a node's heading is `turned_rad` from a direction's."""
        self._sights.add((node, direction))
        self._turned_rad.add(turned_rad)
        self._sight_weights.add(1.0 / std_rad**2)

    def linked(self, starts: IntArray, is_near: BoolArray) -> IntArray:
        """(L,) near nodes reached over edges from the near ones of `starts`, in order."""
        is_reached = np.zeros(len(self), bool)
        is_reached[starts] = True
        is_reached &= is_near
        both = is_near.take(self._ends.all)
        ends = self._ends.all.take(np.flatnonzero(both[:, 0] & both[:, 1]), axis=0)
        start, end = ends.T.copy()
        while True:
            from_start, from_end = is_reached.take(start), is_reached.take(end)
            is_open = from_start != from_end
            if not is_open.any():
                return np.flatnonzero(is_reached)
            is_reached[start[is_open]] = is_reached[end[is_open]] = True
            rest = np.flatnonzero(~(from_start | from_end))
            start, end = start.take(rest), end.take(rest)

    def relax(self, firm_from: int | None = None) -> FloatArray:
        """Move the nodes to where all agrees best; (K,) metres that each went.

        Closures fade where all the rest disagrees, but not edges from `firm_from` on.
        """
        before = self.poses.copy()
        nodes, edges, sights = self._relaxed
        is_new = np.arange(len(self)) >= nodes
        is_new[self._ends.all[edges:][self._is_closure.all[edges:]]] = True
        is_new[self._ends.all[edges:, 1]] = True
        is_new[self._sights.all[sights:, 0]] = True
        constraints = Constraints(
            ends=self._ends.all,
            measured=self._measured.all,
            information=self._information.all,
            fades=self._fading(self.edge_count if firm_from is None else firm_from),
            is_new=np.arange(self.edge_count) >= edges,
            seen=self._sights.all,
            turned_rad=self._turned_rad.all,
            weights=self._sight_weights.all,
            is_new_sight=np.arange(len(self._sights)) >= sights,
        )
        state = State(before, self._directions_rad, self._strain.all.copy())
        state = relax(state, constraints, is_new)
        self.poses[:], self._directions_rad = state.poses, state.directions_rad
        self._strain.all[:] = state.strain
        self._relaxed = len(self), len(self._ends), len(self._sights)
        return np.asarray(np.hypot(*(self.poses - before)[:, :2].T))

    def checkpoint(self) -> Checkpoint:
        """What `restore` goes back to."""
        state = State(self.poses.copy(), self._directions_rad, self._strain.all.copy())
        return Checkpoint(state, len(self._ends), len(self._sights), self._relaxed)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Forget edges, sights and moves since then; no node may have been added."""
        state = checkpoint.state
        self.poses[:], self._directions_rad = state.poses, state.directions_rad
        self._strain.all[:] = state.strain
        for rows in self._edge_rows():
            rows.cut(checkpoint.edges)
        for rows in (self._sights, self._turned_rad, self._sight_weights):
            rows.cut(checkpoint.sights)
        self._relaxed = checkpoint.relaxed

    def rematched(
        self, ends: IntArray, measured: FloatArray, information: FloatArray
    ) -> PoseGraph:
        """The same nodes, motions and sights of directions, with other matches; not relaxed.

        Matches of nodes `ends` (E, 2): the second `measured` (E, 3) from the first, information
        (E, 3, 3) in the first one's frame. What closed a loop is a match like all others then.
        """
        other = PoseGraph()
        other._poses.extend(self.poses)
        other._strain.extend(np.zeros((len(self), 3)))
        motions = np.flatnonzero(self._is_motion.all)
        for rows, own in zip(other._edge_rows(), self._edge_rows(), strict=True):
            rows.extend(own.all[motions])
        count = len(ends)
        seen = (ends, measured, information, np.zeros(count, bool), np.zeros(count, bool))
        for rows, more in zip(other._edge_rows(), seen, strict=True):
            rows.extend(more)
        other._directions_rad = self._directions_rad.copy()
        other._sights.extend(self._sights.all)
        other._turned_rad.extend(self._turned_rad.all)
        other._sight_weights.extend(self._sight_weights.all)
        return other

    def cost(self, firm_from: int) -> float:
        """Chi-squared of all edges that do not fade, as in `relax`."""
        firm = np.flatnonzero(~self._fading(firm_from))
        start, end = self.poses[self._ends.all[firm].T]
        error = between(start, end) - self._measured.all[firm]
        error[:, 2] = wrap_rad(error[:, 2])
        return float(np.einsum("ei,eij,ej->", error, self._information.all[firm], error))

    def _edge_rows(self) -> tuple[GrowingRows, ...]:
        """Ends, what was measured, information, whether it closed a loop, was a motion."""
        return (
            self._ends,
            self._measured,
            self._information,
            self._is_closure,
            self._is_motion,
        )

    def _fading(self, firm_from: int) -> BoolArray:
        """(E,) closures, but for those added lately."""
        fading: BoolArray = self._is_closure.all.copy()
        fading[firm_from:] = False
        return fading


def heading_rotations(headings_rad: FloatArray) -> FloatArray:
    """(N, 3, 3) that turn map-frame errors (x, y, heading) into frames with those headings."""
    turns = np.zeros((len(headings_rad), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(headings_rad)
    turns[:, 0, 1] = np.sin(headings_rad)
    turns[:, 1, 0] = -turns[:, 0, 1]
    turns[:, 2, 2] = 1.0
    return turns
