# SPDX-License-Identifier: MIT
"""The last rounds, when what is left is little and far apart.

Then the way counts and no longer what shows: all of it is toured, to end at home, and the first
stop is where to go next.
"""

from __future__ import annotations

import numpy as np

from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.tour import open_tour

STOPS_MAX = 24  # nearest nodes that are toured
NO_WAY_M = 1e6


def first_stop(graph: NodeGraph, current: int, stops: set[int]) -> int:
    """Which of some nodes to visit first, on a short way past all of them and home."""
    places = sorted(stops)
    costs_m = graph.costs_between([current, 0, *places])
    nearest = np.argsort(costs_m[0, 2:], kind="stable")[:STOPS_MAX]
    toured = np.concatenate([[0], 2 + nearest])
    costs_m = np.minimum(costs_m, NO_WAY_M)
    order, _ = open_tour(costs_m[np.ix_(toured, toured)], costs_m[1, toured])
    return places[int(nearest[order[1] - 1])]
