# SPDX-License-Identifier: MIT
"""Laws of relaxing a part of a graph: as good as all of it, and the rest is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.estimation import relaxation
from ins_robot.estimation.pose_graph import PoseGraph
from ins_robot.geometry.pose2 import between, compose

STIFF = np.diag([1e4, 1e4, 1e5])


def ladder(rng, count=400, noise=0.0):
    """A long corridor driven to and fro: each node tied to the next and to the one beside."""
    truth = np.stack([0.5 * np.arange(count), np.zeros(count), np.zeros(count)], axis=-1)
    truth = np.concatenate([truth, truth[::-1] + np.array([0.0, 0.3, 0.0])])
    truth[:, 2] = rng.uniform(-3.0, 3.0, len(truth))
    graph = PoseGraph()
    for k, pose in enumerate(truth):
        graph.add_node(pose)
        beside = 2 * count - 1 - k
        for other in [k - 1, *([beside] if beside < k else [])]:
            if other >= 0:
                step = between(truth[other], pose) + rng.normal(0.0, noise, 3)
                graph.add_edge(other, k, step, STIFF)
    return graph, truth


def test_a_small_correction_of_a_large_graph_stays_small():
    graph, truth = ladder(np.random.default_rng(1))
    assert not graph.relax().any()
    node = graph.add_node(compose(truth[-1], [0.5, 0.02, 0.01]))
    graph.add_edge(node - 1, node, np.array([0.5, 0.02, 0.01]), STIFF)
    graph.add_edge(
        node - 2, node, between(truth[-2], compose(truth[-1], [0.5, 0.0, 0.0])), STIFF
    )
    before = graph.poses.copy()
    moved = graph.relax()
    assert moved[node] > 0.002
    unmoved = (graph.poses == before).all(axis=1)
    assert unmoved.mean() > 0.9
    assert not unmoved[node - 1]


@pytest.mark.parametrize("off", [(0.01, -0.01, 0.001), (0.3, 0.4, 0.05)])
def test_a_part_relaxed_is_as_good_as_all(monkeypatch, off):
    """A small one as well as a closure so far off that it fades before the nodes make way."""
    count, found = 60, []
    monkeypatch.setattr(relaxation, "WHOLE_NODES", 0)
    for share in (relaxation.WHOLE_SHARE, 0.0):
        monkeypatch.setattr(relaxation, "WHOLE_SHARE", share)
        graph, _ = ladder(np.random.default_rng(2), count, noise=0.002)
        graph.relax()
        start, end = count + 20, 2 * count - 1
        seen = between(graph.poses[start], graph.poses[end]) + off
        graph.add_edge(start, end, seen, STIFF, is_closure=True)
        assert graph.relax().max() > 0.003
        found.append(graph.poses.copy())
    assert found[0] == pytest.approx(found[1], abs=2e-3)


def test_many_small_relaxations_are_as_good_as_one_of_all(monkeypatch):
    """A gyro that turns a little too far, walls that say so: what is held must not add up."""
    monkeypatch.setattr(relaxation, "WHOLE_NODES", 0)
    monkeypatch.setattr(relaxation, "WHOLE_SHARE", 1.1)
    rng, graph = np.random.default_rng(3), PoseGraph()
    graph.add_node(np.zeros(3))
    graph.add_sight(0, graph.add_direction(0.0), 0.0, 0.01)
    for k in range(1, 250):
        step = np.array([0.4, 0.0, 1e-3]) + rng.normal(0.0, [5e-3, 5e-3, 2e-3])
        graph.add_node(compose(graph.poses[k - 1], step))
        graph.add_edge(k - 1, k, step, STIFF)
        graph.add_sight(k, 0, rng.normal(0.0, 0.01), 0.01)
        graph.relax()
    little_by_little = graph.poses.copy()
    monkeypatch.setattr(relaxation, "WHOLE_SHARE", 0.0)
    graph.add_node(compose(graph.poses[-1], step))
    graph.add_edge(249, 250, step, STIFF)
    graph.relax()
    assert graph.poses[:250] == pytest.approx(little_by_little, abs=1e-3)


def test_relaxing_again_changes_nothing():
    graph, _ = ladder(np.random.default_rng(4), 20, noise=0.002)
    graph.relax()
    before = graph.poses.tobytes()
    assert not graph.relax().any()
    assert graph.poses.tobytes() == before


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_linked_is_what_a_walk_over_edges_reaches(seed):
    rng = np.random.default_rng(seed)
    graph = PoseGraph()
    for _ in range(30):
        graph.add_node(np.zeros(3))
    edges = rng.integers(0, 30, (25, 2))
    for start, end in edges:
        graph.add_edge(int(start), int(end), np.zeros(3), STIFF)
    is_near = rng.random(30) < 0.8
    starts = rng.integers(0, 30, 2)
    reached = {int(k) for k in starts if is_near[k]}
    while True:
        more = {
            int(b)
            for one, other in edges
            for a, b in ((one, other), (other, one))
            if int(a) in reached and is_near[b]
        } - reached
        if not more:
            break
        reached |= more
    assert graph.linked(starts, is_near).tolist() == sorted(reached)


def test_the_order_of_the_ring_does_not_matter_for_its_error():
    """Relaxing after each closure ends where relaxing once at the end does."""
    graphs = [PoseGraph(), PoseGraph()]
    turns = np.linspace(0.0, 2 * math.pi, 61)[:-1]
    truth = np.stack([5 * np.sin(turns), 5 - 5 * np.cos(turns), turns], axis=-1)
    rng = np.random.default_rng(4)
    steps = between(truth[:-1], truth[1:]) + rng.normal(0.0, 0.002, (59, 3))
    for graph in graphs:
        graph.add_node(truth[0])
        for k, step in enumerate(steps):
            graph.add_node(compose(graph.poses[k], step))
            graph.add_edge(k, k + 1, step, np.diag([1e3, 1e3, 1e4]))
    for k in range(4):
        for graph in graphs:
            end = 59 - k
            graph.add_edge(end, k, between(truth[end], truth[k]), STIFF, is_closure=True)
        graphs[0].relax()
    graphs[1].relax()
    assert graphs[0].poses == pytest.approx(graphs[1].poses, abs=2e-3)
