# SPDX-License-Identifier: MIT
"""The field's frontier strategies, as their authors describe them; the yardsticks of `auto`.

Yamauchi (1997), with re-checking (Holz et al. 2010); explore_lite as shipped; next-best-view
(Gonzalez-Banos and Latombe 2002). Each takes an outlook and names a place.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.navigation.outlook import Aim, IndexArray, Outlook
from ins_robot.navigation.sight_gain import unseen_in_view

POTENTIAL_SCALE, GAIN_SCALE = 3.0, 1.0  # explore_lite's launch file
GAIN_FALL_PER_M = 0.2  # next-best-view: a metre of way devalues a view by this


class NearestFrontier:
    """The edge cell that costs least to get to, until nothing unseen is beside it."""

    name = "nearest-frontier"
    replan_m = math.inf
    reach_m = math.inf

    def aim(self, outlook: Outlook) -> Aim | None:
        """None when no edge is in reach."""
        edges = outlook.reachable_edges
        if not edges:
            return None
        cells, cost = min(edges, key=lambda edge: float(edge[1].min()))
        return aim_at(outlook, cells[int(cost.argmin())], "nearest edge")


class ExploreLite:
    """explore_lite as shipped: distance weighted with the resolution once too often."""

    name = "explore-lite"
    replan_m = 1.0
    reach_m = math.inf

    def aim(self, outlook: Outlook) -> Aim | None:
        """The least of `3 distance resolution - length`; None when no edge is in reach."""
        here, resolution = np.array(outlook.here), outlook.resolution_m

        def price(cells: IndexArray) -> float:
            away_m = float(np.hypot(*(cells - here).T).min()) * resolution
            length_m = len(cells) * resolution
            return POTENTIAL_SCALE * away_m * resolution - GAIN_SCALE * length_m

        edges = [cells for cells, _ in outlook.reachable_edges]
        if not edges:
            return None
        best = min(edges, key=price)
        return aim_at(outlook, _middle(best), "longest near edge")


class NextBestView:
    """Most unseen ground in view, devalued by the way there."""

    name = "next-best-view"
    replan_m = 1.0
    reach_m = math.inf

    def aim(self, outlook: Outlook) -> Aim | None:
        """The most of `area exp(-0.2 way)`; None when no edge is in reach."""
        best: tuple[float, IndexArray] | None = None
        for cell in representatives(outlook):
            place = outlook.place_at(cell)
            way_m = float(outlook.cost_m[place])
            worth = unseen_in_view(outlook, place) * math.exp(-GAIN_FALL_PER_M * way_m)
            if best is None or worth > best[0]:
                best = worth, cell
        return None if best is None else aim_at(outlook, best[1], "best view")


def aim_at(outlook: Outlook, cell: IndexArray, why: str) -> Aim:
    """Stand at an edge cell."""
    return Aim(cell=outlook.place_at(cell), targets=np.asarray(cell)[None], why=why)


def representatives(outlook: Outlook) -> list[IndexArray]:
    """One edge cell (2,) for about 1.8 ranges of edge (Faigl and Kulich 2013)."""
    found: list[IndexArray] = []
    for cells, _ in outlook.reachable_edges:
        span = 1.8 * outlook.range_m / outlook.resolution_m
        count = 1 + int(len(cells) / span + 0.5)
        if count > 1:
            away: FloatArray = cells - cells.mean(axis=0)
            cells = cells[np.argsort(np.arctan2(away[:, 0], away[:, 1]), kind="stable")]
        found.extend(_middle(part) for part in np.array_split(cells, count))
    return found


def _middle(cells: IndexArray) -> IndexArray:
    """Of cells (n, 2) the one nearest to their mean."""
    middle: IndexArray = cells[int(((cells - cells.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    return middle
