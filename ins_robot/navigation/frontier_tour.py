# SPDX-License-Identifier: MIT
"""TSP over frontiers (Kulich, Faigl and Preucil 2011): the first stop of a tour of all."""

from __future__ import annotations

import math

import numpy as np

from ins_robot.navigation.frontiers import aim_at, representatives
from ins_robot.navigation.outlook import Aim, Outlook
from ins_robot.navigation.tour import open_tour
from ins_robot.navigation.wave import ground_of

STOPS_MAX = 25  # nearest representatives that are toured
NO_WAY_M = 1e6


class FrontierTour:
    """The first stop of a short open tour over the edges' representatives."""

    name = "tsp-frontier"
    replan_m = 1.0
    reach_m = math.inf

    def aim(self, outlook: Outlook) -> Aim | None:
        """None when no edge is in reach."""
        cells = representatives(outlook)
        if not cells:
            return None
        cells = sorted(cells, key=lambda cell: outlook.cost_m[outlook.place_at(cell)])
        cells = cells[:STOPS_MAX]
        places = np.array([outlook.here, *(outlook.place_at(cell) for cell in cells)])
        costs = ground_of(outlook.factor, outlook.resolution_m).costs_between(places)
        order, _ = open_tour(np.minimum(costs, NO_WAY_M))
        return aim_at(outlook, cells[int(order[1]) - 1], f"first of {len(cells)} edges")
