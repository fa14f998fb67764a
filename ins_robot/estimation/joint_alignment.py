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
from ins_robot.estimation.pose_graph import PoseGraph, heading_rotations
from ins_robot.estimation.surfel_residuals import (
    FixedPart,
    Slopes,
    equations_by_source,
    residuals_of,
    shares_of,
    weights_of,
)
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import between
from ins_robot.mapping.occupancy_grid import IntArray

PAIRS_PER_NODE = 12  # those that tell most; all twenty or so take half as much memory more
KERNEL_WIDTHS = (2.0, 1.0)  # a round each; more than two rounds make maps worse (measured)
INFORMATION_MIN = 50.0  # of a pair, m^-2: below it the two hardly see the same
FIT_KEPT_MIN = 0.95  # 0.99 has been seen where the map got better; a torn one fits worse
DAMPING = 1e-3 * np.diag([1.0, 1.0, 4.0])  # of what a pair does not tell; of its information


@dataclass(frozen=True, slots=True)
class _Pairs:
    """What a scan and those under it say of their nodes; how many of its readings lie there."""

    ends: IntArray  # (E, 2) the node that was laid on, and the one that was laid
    measured: FloatArray  # (E, 3) the second as seen from the first
    information: FloatArray  # (E, 3, 3) in the first one's frame
    fit: float


def align_jointly(nodes: NodeMap) -> bool:
    """Move the nodes to where their scans agree best; whether they were.

    The first node stays. All do if the equations have no answer, or if much less of the scans
    lies on the map after the first round; the second one moves by little.
    """
    before, fit = nodes.graph, 0.0
    for width in KERNEL_WIDTHS:
        laid = _laid_on_one_another(nodes, width)
        if laid is None or laid[1] < FIT_KEPT_MIN * fit or not _is_relaxed(laid[0]):
            nodes.graph = before
            return False
        nodes.graph, fit = laid
    return True


def _is_relaxed(graph: PoseGraph) -> bool:
    """Whether a graph could be relaxed, which it is then."""
    try:
        graph.relax()
    except (np.linalg.LinAlgError, RuntimeError):  # scipy: "Factor is exactly singular"
        return False
    return bool(np.isfinite(graph.poses).all())


def _laid_on_one_another(nodes: NodeMap, width: float) -> tuple[PoseGraph, float] | None:
    """The graph with what pairs of scans say as its matches, and how many readings lie well.

    Not relaxed. None when no scan lies on another one.
    """
    laid = [_laid(nodes, node, width) for node in range(len(nodes))]
    pairs = [one for one in laid if one is not None]
    if sum(len(one.ends) for one in pairs) == 0:
        return None
    graph = nodes.graph.rematched(
        np.concatenate([one.ends for one in pairs]),
        np.concatenate([one.measured for one in pairs]),
        np.concatenate([one.information for one in pairs]),
    )
    return graph, sum(one.fit for one in pairs)


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
    known = _of_position(information)
    told = np.flatnonzero((known >= INFORMATION_MIN) & (_rank(known) < PAIRS_PER_NODE))
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
        fit=float(shares_of(residuals, 1.0).sum()),
    )


def _of_position(information: FloatArray) -> FloatArray:
    """(E,) of (E, 3, 3): what is known of the position, in both directions together."""
    return np.asarray(information[:, 0, 0] + information[:, 1, 1])


def _rank(values: FloatArray) -> IntArray:
    """(E,) how many are greater than each, of equals those before it."""
    ranks = np.empty(len(values), np.int64)
    ranks[np.argsort(-values, kind="stable")] = np.arange(len(values))
    return ranks
