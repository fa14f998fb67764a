# SPDX-License-Identifier: MIT
"""The strategies differ in one choice, made from the same situation."""

import numpy as np
import pytest

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.gaps import Gap
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.strategies import Situation, make_strategy

WIDTHS = {0: [0.9, 2.0], 1: [0.5], 2: [1.5, 0.6, 3.0], 3: []}
COSTS = [2.0, 4.0, 3.0, 0.0]
CAME_FROM = [None, 0, 1, 2]


def gap(number, width):
    ends = np.array([[1.0, 0.0], [1.0, width]])
    return Gap(id=number, ends_m=ends, outward=np.array([1.0, 0.0]))


def no_outlook():
    raise AssertionError("a strategy on the graph looks at no grid")


@pytest.fixture
def situation():
    graph = NodeGraph()
    for index, widths in WIDTHS.items():
        graph.add(
            Node(
                index=index, id=10 + index, stamp_s=0.0, pose=Pose2(index, 0.0, 0.0),
                sector=(0.0, 1.0), bearings_rad=np.zeros(0), ranges_m=np.zeros(0),
                gaps=[gap(n, width) for n, width in enumerate(widths)],
                came_from=CAME_FROM[index],
            )
        )  # fmt: skip
    return Situation(
        graph=graph,
        current=3,
        costs_m=lambda: np.array(COSTS),
        candidates=lambda: list(graph.gaps()),
        outlook=no_outlook,
    )


@pytest.mark.parametrize(
    ("name", "node", "width"), [("min-gap", 0, 0.9), ("max-gap", 0, 2.0), ("backtrack", 2, 0.6)]
)
def test_each_strategy_chooses_its_own_gap(situation, name, node, width):
    chosen_node, chosen_gap = make_strategy(name).choose(situation)
    assert (chosen_node.index, chosen_gap.width_m) == (node, width)


@pytest.mark.parametrize("name", ["min-gap", "max-gap", "backtrack"])
def test_without_a_candidate_there_is_no_choice(situation, name):
    empty = Situation(
        graph=situation.graph,
        current=3,
        costs_m=lambda: situation.costs_m,
        candidates=list,
        outlook=no_outlook,
    )
    assert make_strategy(name).choose(empty) is None


def test_only_backtrack_retraces_its_way(situation):
    goal = situation.graph.nodes[0]
    assert make_strategy("min-gap").retraces(situation.graph, goal) == []
    assert make_strategy("max-gap").retraces(situation.graph, goal) == []
    assert make_strategy("backtrack").retraces(situation.graph, goal) == [3, 2, 1, 0]


def test_backtrack_goes_over_the_common_node_to_another_branch(situation):
    graph = situation.graph
    graph.nodes[3].came_from = 0  # 0 - 1 - 2 is one branch, 0 - 3 another
    assert make_strategy("backtrack").retraces(graph, graph.nodes[2]) == [3, 0, 1, 2]


def test_a_node_that_cannot_be_reached_is_the_last_choice(situation):
    costs = situation.costs_m.copy()
    costs[0] = np.inf
    other = Situation(
        graph=situation.graph,
        current=3,
        costs_m=lambda: costs,
        candidates=lambda: situation.candidates,
        outlook=no_outlook,
    )
    node, _ = make_strategy("min-gap").choose(other)
    assert node.index == 2
