# SPDX-License-Identifier: MIT
"""What `auto` leaves for the end: toured on the way home, or not worth the way."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import Gap, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.outlook import Aim, PastLooks
from ins_robot.navigation.rounds import first_stop
from ins_robot.navigation.strategies import LastRounds, Situation

HOME_TO_HERE_M = 20  # a corridor, a node each metre; the robot is at its end


def chain():
    graph = NodeGraph()
    for index in range(HOME_TO_HERE_M + 1):
        gap = Gap(id=0, ends_m=np.array([[1.0, 0.0], [1.0, 0.5]]), outward=np.array([1.0, 0.0]))
        graph.add(
            Node(
                index=index, id=index, stamp_s=0.0, pose=Pose2(index, 0.0, 0.0),
                sector=(0.0, 1.0), bearings_rad=np.zeros(0), ranges_m=np.zeros(0), gaps=[gap],
            )
        )  # fmt: skip
        if index:
            graph.link(index - 1, index, 1.0)
    return graph


def situation(graph, left, edge_m=1.0):
    here = len(graph) - 1
    cells = np.array([[0.0, 10.0 * node.index] for node in graph.nodes])
    looks = PastLooks(cells=cells, towards_rad=cells[:, 0], half_rad=cells[:, 0])

    def all_left():
        return [(n, g) for n, g in graph.gaps() if n.index in left and g.is_open]

    return Situation(
        graph=graph,
        current=here,
        costs_m=lambda: graph.costs_from(here),
        candidates=list,
        outlook=lambda: SimpleNamespace(looks=looks),
        all_left=all_left,
        edge_m=lambda node, gap: edge_m,
    )


def rounds(worth=None, at_node=0):
    aim = Aim(cell=(0, 10 * at_node), targets=np.zeros((0, 2), int), why="", worth=worth or 0.0)
    chooser = SimpleNamespace(
        name="auto", replan_m=1.0, reach_m=6.0, aim=lambda outlook: aim if worth else None
    )
    return LastRounds(chooser)


def test_a_tour_ends_at_home_so_the_farther_side_comes_first():
    graph = chain()
    assert first_stop(graph, 10, {8, 13}) == 13
    assert first_stop(graph, 10, {8}) == 8


@pytest.mark.parametrize("stops", [{1}, {1, 5, 9}, {3, 19}])
def test_on_the_way_home_the_stops_come_in_their_order(stops):
    assert first_stop(chain(), HOME_TO_HERE_M, stops) == max(stops)


def test_what_is_worth_the_way_is_not_left_for_later():
    graph = chain()
    choice = rounds(worth=0.5, at_node=0).choose(situation(graph, {19}))
    assert isinstance(choice, Aim)


def test_little_far_off_waits_for_the_gaps_on_the_way():
    graph = chain()
    node, _ = rounds(worth=0.05, at_node=2).choose(situation(graph, {15, 7}))
    assert node.index == 15
    assert isinstance(rounds(worth=0.05, at_node=17).choose(situation(graph, {15, 7})), Aim)


def test_little_edge_far_off_is_left_and_says_so():
    graph = chain()
    node, _ = rounds().choose(situation(graph, {1, 18}, edge_m=0.2))
    assert node.index == 18
    far = graph.nodes[1].gaps[0]
    assert far.state is GapState.NOT_WORTH_IT
    assert far.why == "0.20 m of edge, 19 m to drive"
    assert rounds().choose(situation(graph, {1}, edge_m=0.2)) is None


def test_where_the_graph_knows_no_way_the_grid_may():
    graph = chain()
    lonely = Node(
        index=len(graph), id=99, stamp_s=0.0, pose=Pose2(5.0, 5.0, 0.0), sector=(0.0, 1.0),
        bearings_rad=np.zeros(0), ranges_m=np.zeros(0),
        gaps=[Gap(id=0, ends_m=np.eye(2), outward=np.array([1.0, 0.0]))],
    )  # fmt: skip
    graph.add(lonely)
    now = situation(graph, {lonely.index}, edge_m=0.1)
    now.current, now.costs_m = 0, graph.costs_from(0)
    assert math.isinf(now.costs_m[lonely.index])
    node, _ = rounds().choose(now)
    assert node is lonely
