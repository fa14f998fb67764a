# SPDX-License-Identifier: MIT
"""Neighbour identification: rules A, B and C, as printed and with the visibility guard."""

import numpy as np
import pytest
from exploring import FULL, RADIUS_M, grid_of, plan, robot_at, rules

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import GapState, find_gaps
from ins_robot.navigation.neighbours import identify_neighbours
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.terrain import BodyRules, survey_terrain

BODY = BodyRules(radius_m=RADIUS_M, clearance_m=0.03)


def two_rooms(door_m):
    low = 2.5 - door_m / 2
    return plan(9, 5, (0.5, 0.5, 4, 4.5), (4, low, 4.1, low + door_m), (4.1, 0.5, 8.5, 4.5))


def graph_of(world, *places, came_from=None):
    """Nodes at places of the world's frame, none of them driven to from another."""
    graph = NodeGraph()
    for index, place in enumerate(places):
        scan = robot_at(world, *place).scan(np.pi)
        graph.add(
            Node(
                index=index,
                id=index,
                stamp_s=0.0,
                pose=Pose2(*place, 0.0),
                sector=FULL,
                bearings_rad=scan.bearings_rad,
                ranges_m=scan.ranges_m,
                gaps=find_gaps(scan, Pose2(), FULL, rules()),
                came_from=came_from,
            )
        )
    return graph


def identify(world, graph, *, is_seen=None, range_m=12.0):
    new = graph.nodes[-1]
    identify_neighbours(
        graph,
        new,
        neighbour_range_m=range_m,
        robot_width_m=2.0 * RADIUS_M,
        terrain=survey_terrain(grid_of(world), new.pose, BODY),
        is_seen=is_seen,
    )


LEFT, RIGHT = (2.0, 2.5), (6.2, 2.5)


@pytest.mark.parametrize("is_seen", [None, lambda node, gap: True])
def test_nodes_on_both_sides_of_a_door_become_neighbours(is_seen):
    world = two_rooms(0.9)
    graph = graph_of(world, LEFT, RIGHT)
    identify(world, graph, is_seen=is_seen)
    assert graph.nodes[0].neighbours.keys() == {1}
    assert graph.costs_from(0)[1] == pytest.approx(4.2, rel=0.2)
    through = [gap for node, gap in graph.gaps() if gap.state is GapState.EXPLORED]
    assert through
    assert all("between nodes 1 and 0" in gap.why for gap in through)


def test_with_the_guard_a_gap_to_unseen_ground_stays_open():
    world = two_rooms(0.9)
    graph = graph_of(world, LEFT, RIGHT)
    identify(world, graph, is_seen=lambda node, gap: False)
    assert graph.nodes[0].neighbours.keys() == {1}
    assert all(gap.state is not GapState.EXPLORED for _, gap in graph.gaps())


@pytest.mark.parametrize("is_seen", [None, lambda node, gap: True])
def test_a_gap_too_narrow_for_the_robot_makes_no_neighbours(is_seen):
    world = two_rooms(0.25)
    graph = graph_of(world, LEFT, RIGHT)
    identify(world, graph, is_seen=is_seen)
    assert not graph.nodes[0].neighbours


@pytest.mark.parametrize("is_seen", [None, lambda node, gap: True])
def test_a_wall_between_makes_no_neighbours(is_seen):
    world = two_rooms(0.9)
    graph = graph_of(world, (3.4, 0.9), (4.7, 0.9))
    identify(world, graph, is_seen=is_seen)
    assert not graph.nodes[0].neighbours


def test_nodes_farther_apart_than_the_range_are_not_looked_at():
    world = two_rooms(0.9)
    graph = graph_of(world, LEFT, RIGHT)
    identify(world, graph, range_m=4.0)
    assert not graph.nodes[0].neighbours


def test_the_previous_node_is_always_a_neighbour():
    world = two_rooms(0.25)
    graph = graph_of(world, LEFT, RIGHT)
    graph.nodes[1].came_from = 0
    identify(world, graph, range_m=1.0)
    assert graph.nodes[0].neighbours.keys() == {1}
