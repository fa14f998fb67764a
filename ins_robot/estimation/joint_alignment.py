# SPDX-License-Identifier: MIT
"""All scans laid on one another at once: nodes in, the same where all that they saw agrees.

While the robot drives, a scan is laid on those before it, and what it errs by is handed on to
those after it. At the end each of them also knows what came later: all are laid on all that
lies around them, and the graph is relaxed with what each pair of scans says of its two nodes
(Lu & Milios 1997; with surfels instead of pairs of points). The motions between nodes and the
directions of walls stay in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ins_robot.estimation.node_map import NodeMap
from ins_robot.estimation.pose_graph import heading_rotations
from ins_robot.estimation.surfel_residuals import (
    FixedPart,
    Slopes,
    costs_of,
    equations_by_source,
    residuals_of,
    shares_of,
    weights_of,
)
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import between
from ins_robot.mapping.occupancy_grid import IntArray

KERNEL_WIDTHS = (2.0, 1.0)  # a round each; more than two rounds make maps worse (measured)
INFORMATION_MIN = 50.0  # of a pair, m^-2: below it the two hardly see the same
COST_GROWTH_MAX = 1.1  # up to 1.02 has been seen where the map got better; torn ones cost more
DAMPING = 1e-3 * np.diag([1.0, 1.0, 4.0])  # of what a pair does not tell; of its information


@dataclass(frozen=True, slots=True)
class _Pairs:
    """What pairs of scans say of their two nodes; and how badly the scans lie, as costs."""

    ends: IntArray  # (E, 2) the node that was laid on, and the one that was laid
    measured: FloatArray  # (E, 3) the second as seen from the first
    information: FloatArray  # (E, 3, 3) in the first one's frame
    cost: float


def align_jointly(nodes: NodeMap) -> bool:
    """Move the nodes to where their scans agree best; whether anything moved.

    The first node stays. If the scans lie much worse after a round, all stay as they were.
    """
    before, cost = nodes.graph, np.inf
    for width in KERNEL_WIDTHS:
        pairs = _laid_pairs(nodes, width)
        if pairs is None or pairs.cost > COST_GROWTH_MAX * cost:
            nodes.graph = before
            return False
        cost = pairs.cost
        nodes.graph = nodes.graph.rematched(pairs.ends, pairs.measured, pairs.information)
        nodes.graph.relax()
    return True


def _laid_pairs(nodes: NodeMap, width: float) -> _Pairs | None:
    """All scans, each laid on those of the nodes around it; None when none lies on another."""
    laid = [_laid(nodes, node, width) for node in range(len(nodes))]
    pairs = [one for one in laid if one is not None]
    if not pairs:
        return None
    return _Pairs(
        ends=np.concatenate([one.ends for one in pairs]),
        measured=np.concatenate([one.measured for one in pairs]),
        information=np.concatenate([one.information for one in pairs]),
        cost=sum(one.cost for one in pairs),
    )


def _laid(nodes: NodeMap, node: int, width: float) -> _Pairs | None:
    """One scan where it is: what it and those under it say, with a kernel so much wider."""
    poses = nodes.graph.poses
    pose = poses[node]
    around = nodes.linked(np.array([node]), pose)
    field = nodes.local_field(around[around != node], pose)
    scan = nodes.surfels(node)
    if field is None or len(scan) == 0:
        return None
    residuals = residuals_of(field, FixedPart.of(scan), pose[None])
    weights = weights_of(residuals, shares_of(residuals, width))
    source, information, gradient = equations_by_source(
        field.surfels.sources, residuals, Slopes.of(residuals), weights, 0
    )
    told = np.flatnonzero(_of_position(information) >= INFORMATION_MIN)
    source, starts = source[told], poses[source[told]]
    turn = heading_rotations(starts[:, 2])
    information = turn @ information[told] @ turn.swapaxes(1, 2)
    gradient = turn @ gradient[told, :, None]
    damping = _of_position(information)[:, None, None] * DAMPING
    pulled = np.linalg.solve(information + damping, gradient)[..., 0]
    return _Pairs(
        ends=np.stack([source, np.full(len(source), node)], axis=-1),
        measured=between(starts, pose) - pulled,
        information=information,
        cost=float(costs_of(shares_of(residuals, 1.0))[0]),
    )


def _of_position(information: FloatArray) -> FloatArray:
    """(E,) of (E, 3, 3): what is known of the position, in both directions together."""
    return np.asarray(information[:, 0, 0] + information[:, 1, 1])
