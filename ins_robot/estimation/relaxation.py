# SPDX-License-Identifier: MIT
"""Poses and what is known between them in, poses that agree best out; only what has to moves.

Sparse Gauss-Newton (Lu & Milios 1997; Grisetti et al. 2010), the first node held. Closures
and sights fade by dynamic covariance scaling (Agarwal et al. 2013) when they disagree with all
the rest. It begins with a window around what is new, whose surroundings are held, and
widens it until nothing pulls at them: a small correction of a large map costs little.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import between
from ins_robot.mapping.occupancy_grid import BoolArray, IntArray

POSE_SIZE = 3
STEPS_MAX = 6  # once the window is wide enough
CONVERGED_M = 1e-4
CONSISTENT_CHI2 = 1e-12
FADE_CHI2 = 25.0  # a closure off by more than this fades
PULLED_M, PULLED_RAD = 3e-4, 1e-4  # what would move by more is not held
WHOLE_SHARE = 0.8  # a window of more nodes than this is the whole graph at once
WHOLE_NODES = 300  # a graph this small costs no more as a whole
REGULAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Constraints:
    """Edges between nodes, and nodes' sights of directions.

    Attributes
    ----------
    ends : (E, 2) int
        Start and end node.
    measured : (E, 3)
        The end as seen from the start.
    information : (E, 3, 3)
        In the start's frame.
    fades : (E,) bool
        Closures, which the rest may overrule.
    is_new : (E,) bool
        Edges that have not been relaxed with; nothing has made way for them.
    seen : (S, 2) int
        Node and direction.
    turned_rad, weights : (S,)
        How far the node's heading is from the direction's, and 1 / variance.
    is_new_sight : (S,) bool
    """

    ends: IntArray
    measured: FloatArray
    information: FloatArray
    fades: BoolArray
    is_new: BoolArray
    seen: IntArray
    turned_rad: FloatArray
    weights: FloatArray
    is_new_sight: BoolArray

    def around(self, is_free: BoolArray) -> Constraints:
        """Those edges that reach a free node (K,), and all sights."""
        reaches = is_free[self.ends].any(axis=1)
        return self if reaches.all() else self.of(np.flatnonzero(reaches))

    def of(self, part: IntArray) -> Constraints:
        """Some of the edges, and all sights."""
        return replace(
            self,
            ends=self.ends[part],
            measured=self.measured[part],
            information=self.information[part],
            fades=self.fades[part],
            is_new=self.is_new[part],
        )


@dataclass(frozen=True, slots=True)
class State:
    """Node poses (K, 3) and directions (D,), map frame; and what still pulls at the nodes.

    `strain` (K, 3) is the gradient that held nodes were left with: little each time, but it
    adds up.
    """

    poses: FloatArray
    directions_rad: FloatArray
    strain: FloatArray


def relax(state: State, constraints: Constraints, is_new: BoolArray) -> State:
    """The state where all agrees best; elsewhere than at `is_new` (K,) it agreed before."""
    if not is_new.any():
        return state
    before, hops, steps = state, 0, 0
    is_small = len(is_new) <= WHOLE_NODES
    is_free = np.full(is_new.shape, is_small or _fades(state, constraints))
    pulled, strain = is_new, state.strain
    while steps < STEPS_MAX:
        if pulled.any():
            is_free |= _widened(pulled, constraints.ends, hops)
            if is_free.mean() > WHOLE_SHARE:
                is_free[:] = True
            is_free[0] = False
            window, hops, steps = constraints.around(is_free), max(1, 2 * hops), 0
        step = _step(state, window, is_free)
        state, steps = _moved(state, step, is_free), steps + 1
        pulled, strain = _pulled(before, state, window, is_free)
        if not pulled.any() and np.abs(step).max(initial=0.0) < CONVERGED_M:
            break
    return replace(state, strain=strain)


def _fades(state: State, constraints: Constraints) -> bool:
    """Whether a new closure is so far off that all must be free for it to be reached."""
    closures = constraints.of(np.flatnonzero(constraints.is_new & constraints.fades))
    return bool(_linear(state, closures).chi2.max(initial=0.0) > FADE_CHI2)


def _widened(is_free: BoolArray, ends: IntArray, hops: int) -> BoolArray:
    """What is so many edges away, too."""
    is_free = is_free.copy()
    for _ in range(hops):
        is_open = is_free[ends[:, 0]] != is_free[ends[:, 1]]
        is_free[ends[is_open]] = True
    return is_free


def _moved(state: State, step: FloatArray, is_free: BoolArray) -> State:
    free = np.flatnonzero(is_free)
    poses = state.poses.copy()
    poses[free] += step[: POSE_SIZE * len(free)].reshape(-1, POSE_SIZE)
    poses[free, 2] = wrap_rad(poses[free, 2])
    directions_rad = state.directions_rad + step[POSE_SIZE * len(free) :]
    return replace(state, poses=poses, directions_rad=directions_rad)


@dataclass(frozen=True, slots=True)
class _Linear:
    """Edges (E) and sights (S) around a state: errors, their weights, and slopes."""

    error: FloatArray  # (E, 3)
    weighted: FloatArray  # (E, 3, 3)
    slopes: FloatArray  # (2, E, 3, 3) by start and by end
    off_rad: FloatArray  # (S,)
    weights: FloatArray  # (S,)
    chi2: FloatArray  # (E,)
    sight_chi2: FloatArray  # (S,)

    def left(self) -> FloatArray:
        """(2, E, 3, 3) slopes, transposed, times weights: what the normal equations have."""
        return np.asarray(self.slopes.swapaxes(-1, -2) @ self.weighted)

    def pulls(self) -> FloatArray:
        """(2, E, 3) gradient of each edge by its start and by its end."""
        return np.asarray((self.left() @ self.error[..., None])[..., 0])


def _linear(state: State, window: Constraints) -> _Linear:
    a, b = state.poses[window.ends[:, 0]], state.poses[window.ends[:, 1]]
    error = between(a, b) - window.measured  # in the start's frame
    error[:, 2] = wrap_rad(error[:, 2])
    chi2 = ((window.information @ error[..., None])[..., 0] * error).sum(axis=1)
    faded = np.where(window.fades, _fade(chi2), 1.0)
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    slopes = np.zeros((2, len(a), 3, 3))
    by_start, by_end = slopes
    by_end[:, 0, 0], by_end[:, 0, 1], by_end[:, 1, 0], by_end[:, 1, 1] = c, s, -s, c
    by_end[:, 2, 2] = 1.0
    by_start -= by_end
    by_start[:, 0, 2] = -s * dx + c * dy
    by_start[:, 1, 2] = -c * dx - s * dy
    off = wrap_rad(
        state.poses[window.seen[:, 0], 2]
        - state.directions_rad[window.seen[:, 1]]
        - window.turned_rad
    )
    sight_chi2 = window.weights * off**2
    return _Linear(
        error=error,
        weighted=window.information * (faded**2)[:, None, None],
        slopes=slopes,
        off_rad=off,
        weights=window.weights * _fade(sight_chi2) ** 2,
        chi2=chi2,
        sight_chi2=sight_chi2,
    )


def _step(state: State, window: Constraints, is_free: BoolArray) -> FloatArray:
    """(3 F + D,) step of the F free nodes, then of the directions; zero where all agrees."""
    equations = _equations(state, window, is_free)  # what they were made of is gone by here
    if equations is None:
        return np.zeros(POSE_SIZE * int(is_free.sum()) + len(state.directions_rad))
    matrix, gradient = equations
    # positive definite: pivots are taken where the ordering has them, or it would fill up
    factors = splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.asarray(factors.solve(-gradient))


def _equations(
    state: State, window: Constraints, is_free: BoolArray
) -> tuple[csc_matrix, FloatArray] | None:
    """Matrix (N, N) and gradient (N,) of such a step; None where all agrees."""
    count, directions = int(is_free.sum()), len(state.directions_rad)
    size = POSE_SIZE * count + directions
    linear = _linear(state, window)
    if max(linear.chi2.max(initial=0.0), linear.sight_chi2.max(initial=0.0)) < CONSISTENT_CHI2:
        return None
    slot = np.where(is_free, np.cumsum(is_free) - 1, -1).astype(np.int32)
    ends, axis = slot[window.ends].astype(np.int64), np.arange(POSE_SIZE)
    gradient = np.zeros(size)
    left = linear.left()
    pulls = (left @ linear.error[..., None])[..., 0]
    own = np.zeros((count, POSE_SIZE, POSE_SIZE))
    for i in (0, 1):
        here = np.flatnonzero(ends[:, i] >= 0)
        at = POSE_SIZE * ends[here, i, None] + axis
        gradient += np.bincount(at.ravel(), pulls[i, here].ravel(), size)
        np.add.at(own, ends[here, i], left[i, here] @ linear.slopes[i, here])
    first, second, shared = _shared(ends, left[0], linear.slopes[1])
    rows, cols, values = [], [], []
    every = np.arange(count)
    for of, by, blocks in (
        (every, every, own),
        (first, second, shared),
        (second, first, shared.swapaxes(1, 2)),
    ):
        row, col = POSE_SIZE * of[:, None, None] + axis[:, None], POSE_SIZE * by[:, None, None]
        rows.append(np.broadcast_to(row, blocks.shape).astype(np.int32).ravel())
        cols.append(np.broadcast_to(col + axis, blocks.shape).astype(np.int32).ravel())
        values.append(blocks.ravel())
    direction = (POSE_SIZE * count + window.seen[:, 1]).astype(np.int32)
    heading = POSE_SIZE * slot[window.seen[:, 0]] + 2
    weights, moves = linear.weights, heading >= 0
    pull = weights * linear.off_rad
    gradient -= np.bincount(direction, pull, size)
    gradient += np.bincount(heading[moves], pull[moves], size)
    rows += [direction, heading[moves], heading[moves], direction[moves]]
    cols += [direction, heading[moves], direction[moves], heading[moves]]
    values += [weights, weights[moves], -weights[moves], -weights[moves]]
    everything = np.arange(size, dtype=np.int32)
    matrix = coo_matrix(
        (
            np.concatenate([*values, np.full(size, REGULAR)]),
            (np.concatenate([*rows, everything]), np.concatenate([*cols, everything])),
        ),
        shape=(size, size),
    ).tocsc()
    return matrix, gradient


def _shared(
    ends: IntArray, left: FloatArray, slopes: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """First node (N,), second (N,), block (N, 3, 3) of all edges between two free ones.

    Edges to and fro between the same two become one block: there may be many.
    """
    both = np.flatnonzero((ends >= 0).all(axis=1))
    blocks = left[both] @ slopes[both]  # by the start's pose in rows, the end's in columns
    start, end = ends[both, 0], ends[both, 1]
    swapped = start > end
    blocks[swapped] = blocks[swapped].swapaxes(1, 2)
    pair = np.minimum(start, end) * (ends.max(initial=0) + 1) + np.maximum(start, end)
    pairs, of = np.unique(pair, return_inverse=True)
    total = np.zeros((len(pairs), *blocks.shape[1:]))
    np.add.at(total, of, blocks)
    first, second = np.divmod(pairs, ends.max(initial=0) + 1)
    return first, second, total


def _pulled(
    before: State, after: State, window: Constraints, is_free: BoolArray
) -> tuple[BoolArray, FloatArray]:
    """(K,) bool: held nodes that would move now, as those beside them have; the strain."""
    window = window.of(np.flatnonzero(~is_free[window.ends].all(axis=1)))  # its rim
    old, new = _linear(before, window), _linear(after, window)
    force, stiffness = np.zeros(before.poses.shape), np.zeros((*is_free.shape, 3, 3))
    change = new.pulls() - old.pulls() * ~window.is_new[:, None]
    is_rim = np.zeros(is_free.shape, bool)
    for i in (0, 1):
        held = np.flatnonzero(~is_free[window.ends[:, i]])
        node, slope = window.ends[held, i], new.slopes[i, held]
        np.add.at(force, node, change[i, held])
        np.add.at(stiffness, node, slope.swapaxes(1, 2) @ new.weighted[held] @ slope)
        is_rim[node] = True
    seen, rested = window.seen[:, 0], old.weights * old.off_rad * ~window.is_new_sight
    np.add.at(force[:, 2], seen, new.weights * new.off_rad - rested)
    np.add.at(stiffness[:, 2, 2], seen, new.weights)
    strain = np.where(is_free[:, None], 0.0, before.strain + force)
    force[is_rim] = strain[is_rim]
    pulled = ~is_free & force.any(axis=1)
    pulled[0] = False
    node = np.flatnonzero(pulled)
    step = np.linalg.solve(stiffness[node] + np.eye(3), force[node, :, None])[..., 0]
    pulled[node] = (np.hypot(*step[:, :2].T) > PULLED_M) | (np.abs(step[:, 2]) > PULLED_RAD)
    return pulled, strain


def _fade(chi2: FloatArray) -> FloatArray:
    """(E,) factor on each error: 1, falling for those that disagree with the rest."""
    return np.asarray(np.minimum(1.0, 2.0 * FADE_CHI2 / (FADE_CHI2 + chi2)))
