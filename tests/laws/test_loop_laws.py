# SPDX-License-Identifier: MIT
"""Closing loops: what the rest of the graph contradicts is dropped, and nothing stays of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.estimation.loop_closing import Closure, Train
from ins_robot.estimation.node_map import NodeMap
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import between, compose, inverse, transform_points
from ins_robot.mapping.surfels import Surfels
from ins_robot.messages import LaserScan

NODES = 40
RADIUS_M = 5.0
FIRM = np.diag([1e4, 1e4, 1e5])
SCAN = LaserScan(
    stamp_s=0.0,
    bearings_rad=np.zeros(0),
    ranges_m=np.zeros(0),
    range_std_m=np.zeros(0),
    beam_offsets_s=np.zeros(0),
    range_max_m=6.0,
    rpm=math.nan,
    valid_counts=np.zeros(0, np.int64),
    is_free_when_silent=False,
)
NOTHING = Surfels(
    points_m=np.zeros((0, 2)),
    normals=np.zeros((0, 2)),
    is_flat=np.zeros(0, bool),
    std_m=np.zeros(0),
    tilt_std_rad=np.zeros(0),
    is_lone=np.zeros(0, bool),
    sources=np.zeros(0, np.int64),
)


def ring(
    drift_m: float = 0.0,
    is_closed: bool = True,
    step_std_m: float = 0.01,
    count: int = NODES,
    slip_m: float = 0.0,
) -> tuple[NodeMap, np.ndarray]:
    """A drive around a ring whose estimate drifted, and the true poses (K, 3).

    `slip_m`: halfway a step was laid wrong by so much, and all after it with it.
    """
    known = np.diag([1.0, 1.0, 10.0]) / step_std_m**2
    angles = np.arange(count) * (2.0 * math.pi / count)
    true = np.stack(
        [RADIUS_M * np.sin(angles), RADIUS_M * (1.0 - np.cos(angles)), wrap_rad(angles)],
        axis=-1,
    )
    stray = np.linspace(0.0, 1.0, count)[:, None] * [drift_m, 0.0, 0.0]
    stray[count // 2 :, 1] += slip_m
    nodes = NodeMap()
    for pose in true + stray:
        node = nodes.add(pose, SCAN, NOTHING, 0.0)
        if node:
            step = between(nodes.graph.poses[node - 1], pose)
            nodes.graph.add_edge(node - 1, node, step, known)
    if is_closed:
        nodes.graph.add_edge(0, count - 1, between(true[0], true[-1]), known)
    return nodes, true


def closure(nodes: NodeMap, node: int, source: int, pose: np.ndarray) -> Closure:
    """`node` recognised at `pose` (3,), map frame, by what `source` saw."""
    match = Alignment(
        pose=pose,
        information=FIRM,
        gradient=np.zeros(3),
        inlier_share=0.9,
        inliers=200,
        cost=0.0,
        is_inlier=np.ones(200, bool),
        by_source={source: FIRM},
    )
    at = nodes.graph.poses[node]
    return Closure(
        node=node,
        pose=pose,
        match=match,
        correction=compose(pose, inverse(at)),
        moved_m=math.dist(pose[:2], at[:2]),
        turned_rad=abs(float(pose[2] - at[2])),
        rival_ratio=0.0,
    )


@pytest.mark.parametrize("drift_m", [0.3, 2.0])
@pytest.mark.parametrize(
    ("count", "sigmas"), [(NODES, 1.0), (3 * NODES, 4.5), (25 * NODES, 3.0)]
)
def test_a_loop_that_drifted_as_its_edges_allow_is_closed(
    drift_m: float, count: int, sigmas: float
) -> None:
    step_std_m = drift_m / (sigmas * math.sqrt(count))
    nodes, true = ring(drift_m, is_closed=False, step_std_m=step_std_m, count=count)
    found = [closure(nodes, k, 0, true[k]) for k in (count - 2, count - 1)]
    assert Train(found).close(nodes)
    np.testing.assert_allclose(nodes.graph.poses[-1], true[-1], atol=0.05 * drift_m)


@pytest.mark.parametrize("off", [(1.5, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.2)])
@pytest.mark.parametrize("count", [NODES, 8 * NODES])
def test_what_all_else_contradicts_is_dropped_and_leaves_no_trace(
    off: tuple[float, float, float], count: int
) -> None:
    """A corridor's other end: three nodes in a row agree about it, and all are wrong."""
    nodes, true = ring(count=count)
    untouched, _ = ring(count=count)
    for graph in (nodes.graph, untouched.graph):
        direction = graph.add_direction(0.0)
        for k in range(0, count, 5):
            graph.add_sight(k, direction, float(true[k, 2]) + 0.001 * math.sin(k), 0.01)
        graph.relax()
    before = nodes.graph.poses.copy()
    found = [closure(nodes, k, k - 17, true[k] + off) for k in (20, 21, 22)]
    assert not Train(found).close(nodes)
    np.testing.assert_array_equal(nodes.graph.poses, before)
    for each in (nodes, untouched):  # and what comes later goes as if nothing had been
        late = closure(each, 30, 3, each.graph.poses[30] + [0.03, 0.0, 0.0])
        assert Train([late]).close(each)
    np.testing.assert_array_equal(nodes.graph.poses, untouched.graph.poses)
    assert nodes.graph.edge_count == untouched.graph.edge_count
    np.testing.assert_array_equal(nodes.graph.directions_rad, untouched.graph.directions_rad)


def test_what_is_settled_is_linked_and_moves_nothing() -> None:
    nodes, true = ring()
    before, edges = nodes.graph.poses.copy(), nodes.graph.edge_count
    found = [closure(nodes, 20, 3, true[20] + [0.01, 0.0, 0.0])]
    assert Train(found).close(nodes)
    assert nodes.graph.edge_count == edges + 1
    np.testing.assert_array_equal(nodes.graph.poses, before)


def test_many_that_say_the_same_overrule_a_scan_that_was_laid_wrong() -> None:
    """One step of the way is off and sure of it: the loop is refused, but not for ever."""
    nodes, true = ring(is_closed=False, slip_m=0.5)
    before = nodes.graph.poses.copy()
    train = Train([closure(nodes, k, k - 26, true[k]) for k in (26, 27, 28)])
    assert train.is_ripe
    assert not train.close(nodes)
    np.testing.assert_array_equal(nodes.graph.poses, before)
    assert not train.is_ripe  # the same three will not do better
    train.closures += [closure(nodes, k, k - 26, true[k]) for k in (29, 30, 31)]
    assert train.is_ripe
    assert train.close(nodes)
    np.testing.assert_allclose(nodes.graph.poses[26:], true[26:], atol=0.03)


def test_a_point_before_a_wall_was_seen_past_but_not_one_behind_or_beside_it() -> None:
    wall = np.stack([np.full(41, 3.0), np.linspace(-1.0, 1.0, 41)], axis=-1)
    seen = replace(
        NOTHING,
        points_m=wall,
        normals=np.tile([-1.0, 0.0], (41, 1)),
        is_flat=np.ones(41, bool),
        std_m=np.full(41, 0.01),
        tilt_std_rad=np.full(41, 0.01),
        is_lone=np.zeros(41, bool),
        sources=np.zeros(41, np.int64),
    )
    points = np.array([[1.5, 0.0], [2.9, 0.0], [3.5, 0.0], [0.0, 1.5], [-1.0, 0.0]])
    for pose in ([0.0, 0.0, 0.0], [2.0, -1.0, 0.7], [0.0, 4.0, -3.1]):
        nodes = NodeMap()
        nodes.add(np.array(pose), SCAN, seen, 0.0)
        nodes.add(np.array([50.0, 0.0, 0.0]), SCAN, seen, 0.0)
        placed = transform_points(np.array(pose), points)
        past = nodes.seen_past(np.array([0, 1]), placed)
        assert past.tolist() == [True, False, False, False, False]
