# SPDX-License-Identifier: MIT
"""Laws of the exploration: what may not depend on where the map's axes point, and costs."""

from itertools import pairwise

import numpy as np
import pytest
from exploring import FULL, RADIUS_M, configured, explore, plan, robot_at, rules
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import find_gaps
from ins_robot.navigation.neighbours import crosses
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.simulation.truth import coverage
from ins_robot.simulation.visibility import visible_cells
from ins_robot.simulation.world import World

FLAT = plan(
    10, 7,
    (0.5, 0.5, 4, 6.5), (4, 2, 4.1, 2.9), (4.1, 0.5, 9.5, 3.4), (6, 3.4, 7.2, 6.5),
    walls=[(1.5, 4.4, 2.2, 4.7)],
)  # fmt: skip


def node_of(index, pose, gaps=()):
    return Node(
        index=index, id=index, stamp_s=0.0, pose=pose, sector=FULL,
        bearings_rad=np.zeros(0), ranges_m=np.zeros(0), gaps=list(gaps),
    )  # fmt: skip


@pytest.mark.parametrize("turn_deg", [1, 37, 90, 213])
def test_gaps_do_not_depend_on_where_the_robot_faces(turn_deg):
    """In the map frame a turned scan shows the same gaps, width for width."""
    turn = np.radians(turn_deg)
    found = []
    for heading in (0.0, turn):
        scan = robot_at(FLAT, 2.5, 2.6, heading).scan(np.pi)
        node = node_of(0, Pose2(2.5, 2.6, heading), find_gaps(scan, Pose2(), FULL, rules()))
        rows = [(*node.centroid_m(gap), gap.width_m, *node.outward(gap)) for gap in node.gaps]
        found.append(np.array(sorted(rows)))
    assert len(found[0]) > 0
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.integers(0, 2**32 - 1))
def test_crossing_is_the_same_in_every_frame(x, y, heading, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 2))
    starts, ends = rng.normal(size=(2, 30, 2))
    moved = Pose2(x, y, heading)
    here = crosses(a, b, starts, ends)
    there = crosses(*moved.apply(np.stack([a, b])), moved.apply(starts), moved.apply(ends))
    np.testing.assert_array_equal(here, there)
    np.testing.assert_array_equal(here, crosses(b, a, ends, starts))


@settings(max_examples=40)
@given(st.integers(2, 14), st.integers(0, 2**32 - 1))
def test_travel_costs_are_a_metric(count, seed):
    """Symmetric, zero at home, and no node is cheaper to reach over another one."""
    rng = np.random.default_rng(seed)
    graph = NodeGraph()
    for index in range(count):
        graph.add(node_of(index, Pose2(*rng.uniform(0, 10, 2), 0.0)))
        for other in range(index):
            if other == index - 1 or rng.random() < 0.3:
                graph.link(index, other, float(rng.uniform(0.1, 9.0)))
    costs = np.array([graph.costs_from(index) for index in range(count)])
    np.testing.assert_allclose(costs, costs.T)
    np.testing.assert_array_equal(np.diag(costs), 0.0)
    over = costs[:, :, None] + costs[None, :, :]  # from i over j to k
    assert (costs[:, None, :] <= over + 1e-9).all()
    for goal in range(count):
        way = graph.way(0, goal)
        assert way[0] == 0
        assert way[-1] == goal
        steps = [graph.nodes[a].neighbours[b] for a, b in pairwise(way)]
        assert sum(steps) == pytest.approx(costs[0, goal])


def test_the_cheaper_of_two_ways_counts():
    graph = NodeGraph()
    for index in range(2):
        graph.add(node_of(index, Pose2()))
    graph.link(0, 1, 5.0)
    graph.link(1, 0, 3.0)
    graph.link(0, 1, 4.0)
    assert graph.costs_from(0)[1] == graph.costs_from(1)[0] == 3.0


def test_what_is_kept_of_the_graph_follows_its_nodes():
    graph, way = NodeGraph(), np.array([[0.5, 0.0], [1.0, 0.0]])
    graph.add(node_of(0, Pose2(1.0, 2.0, 0.0)))
    graph.add(node_of(1, Pose2(2.0, 2.0, 0.0)))
    graph.nodes[1].came_from, graph.nodes[1].came_by_m, graph.nodes[1].way_m = 0, way, 1.0
    np.testing.assert_allclose(graph.driven_m(), [[1.5, 2.0], [2.0, 2.0]])
    moved = Pose2(1.0, 3.0, np.pi / 2)
    graph.move(0, moved)
    np.testing.assert_allclose(graph.driven_m(), moved.apply(way))
    np.testing.assert_allclose(graph.poses()[0], moved.as_array())
    graph.nodes[1].came_by_m = way[:1]
    np.testing.assert_allclose(graph.driven_m(), moved.apply(way[:1]))
    graph.add(node_of(2, Pose2(5.0, 5.0, 0.0)))
    assert len(graph.poses()) == len(graph.sectors()) == 3
    np.testing.assert_allclose(graph.positions_m()[2], [5.0, 5.0])


@pytest.mark.parametrize("quarter_turns", [1, 2])
def test_a_turned_world_is_explored_as_well(quarter_turns):
    """Up to effects of the grid: all of it seen, with about as many scans."""
    height_m = FLAT.is_occupied.shape[0] * 0.05
    width_m = FLAT.is_occupied.shape[1] * 0.05
    x, y = 2.5, 2.6
    turned = FLAT.is_occupied
    for _ in range(quarter_turns):
        turned = np.rot90(turned, -1)  # rows grow upwards: this turns counter-clockwise
        x, y, width_m, height_m = height_m - y, x, height_m, width_m
    runs = []
    for walls, place in ((FLAT.is_occupied, (2.5, 2.6)), (turned, (x, y))):
        world = World(walls, 0.05)
        run = explore(world, *place, configured(strategy="min-gap"))
        visible = visible_cells(world, Pose2(*place, 0.0), RADIUS_M, 6.0)
        assert coverage(run.robot.seen.is_seen(), visible) >= 0.99
        assert run.robot.contacts == 0
        runs.append(run)
    first, second = (len(run.explorer.graph.nodes[0].gaps) for run in runs)
    assert first == second
    assert abs(runs[0].scans - runs[1].scans) <= 4
