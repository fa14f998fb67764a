# SPDX-License-Identifier: MIT
"""Open tours against every order there is."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from ins_robot.navigation.tour import open_tour


def costs_of(count, seed):
    places = np.random.default_rng(seed).random((count, 2))
    return np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))


def cost_of(order, costs, end_m):
    return sum(costs[a, b] for a, b in pairwise(order)) + end_m[order[-1]]


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("has_end", [False, True])
def test_a_tour_of_seven_is_nearly_the_best(seed, has_end):
    costs = costs_of(7, seed)
    end_m = np.random.default_rng(seed + 100).random(7) * has_end
    order, cost = open_tour(costs, end_m)
    assert order[0] == 0
    assert sorted(order) == list(range(7))
    assert cost == pytest.approx(cost_of(order.tolist(), costs, end_m))
    best = min(cost_of((0, *rest), costs, end_m) for rest in permutations(range(1, 7)))
    assert cost <= 1.05 * best + 1e-9


def test_the_price_of_the_end_decides_where_the_tour_ends():
    line = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 2.0], [1.0, 2.0, 0.0]])
    assert open_tour(line, np.array([0.0, 0.0, 5.0]))[0].tolist() == [0, 2, 1]
    assert open_tour(line, np.array([0.0, 5.0, 0.0]))[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_tours(count):
    order, _ = open_tour(costs_of(count, 1))
    assert sorted(order.tolist()) == list(range(count))
