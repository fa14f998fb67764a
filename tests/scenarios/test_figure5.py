# SPDX-License-Identifier: MIT
"""A world shaped like the paper's figure 5, explored on the pure core with a perfect robot.

N1 opens on a crossing (N2); the narrow way leads round a block to N7, from which the crossing
can be driven to directly. When the chain of rooms behind N7 has ended dead, the robot goes back
to N2's last gap over that link, found by neighbour identification without an explicit scan.
"""

from itertools import pairwise

import numpy as np
import pytest
from exploring import RADIUS_M, bench, configured

from ins_robot.navigation.explorer import Drive
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World


@pytest.fixture(scope="module")
def world():
    return World.builtin("figure5")


@pytest.fixture(scope="module")
def runs(world):
    start = world.start_pose(None, RADIUS_M)
    return {
        name: bench.run_to_end(world, start, configured(strategy=name))
        for name in ("min-gap", "backtrack")
    }


def test_both_see_everything_and_touch_nothing(world, runs):
    visible = visible_cells(world, world.start_pose(None, RADIUS_M), RADIUS_M, 6.0)
    for run in runs.values():
        assert run.decision.is_complete
        assert run.robot.contacts == 0
        assert coverage(run.robot.seen.is_seen(), visible) >= 0.99


def test_nodes_far_apart_in_time_are_linked_without_a_scan_between(runs):
    graph = runs["min-gap"].explorer.graph
    links = [
        (node.index, other)
        for node in graph.nodes
        for other in node.neighbours
        if other < node.index and node.came_from != other
    ]
    assert any(new - old >= 3 for new, old in links)


def test_the_far_node_is_reached_over_such_a_link(world):
    """Some drive to an old node's gap is far shorter than the way back by traversal."""
    start = world.start_pose(None, RADIUS_M)
    saved_m = []
    for run in bench.explore(world, start, configured(strategy="min-gap")):
        if not isinstance(run.decision, Drive):
            continue
        graph = run.explorer.graph
        goal = next(node for node in graph.nodes if node.id == run.decision.node_id)
        way = graph.way(len(graph) - 1, goal.index)
        over_links = any(
            graph.nodes[max(a, b)].came_from != min(a, b) for a, b in pairwise(way)
        )
        if over_links:
            traversed = [goal.index, *range(goal.index + 1, len(graph))]
            back_m = sum(
                np.hypot(*(graph.nodes[b].position_m - graph.nodes[a].position_m))
                for a, b in pairwise(traversed)
            )
            saved_m.append(back_m - graph.costs_from(len(graph) - 1)[goal.index])
    assert max(saved_m) > 3.0


def test_the_whole_run_is_shorter_than_with_backtrack(runs):
    assert runs["min-gap"].robot.path_m < 0.95 * runs["backtrack"].robot.path_m
