# SPDX-License-Identifier: MIT
"""`auto`: most new ground for the way.

Of the places the robot can reach, the one from which a scan is expected to show most unseen
ground for what it costs to get there. Places are compared, not edges: one from which several
gaps show wins, and what shows from afar is not driven to. Small pockets are closed while they
are near, because the way counts from nearly nothing; and on the way to a far place the robot
first looks where it shows more for the detour, since it would have to come back for that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.mapping.neighbourhood import set_cells
from ins_robot.navigation.coarse_outlook import coarsened, refined
from ins_robot.navigation.demands import Demands, demands_of, pairs_near, shows_from
from ins_robot.navigation.outlook import Aim, BoolArray, IndexArray, Outlook, PastLooks
from ins_robot.navigation.wave import wave

CELL_M = 0.1  # what is seen from where is worked out in cells of this size
STOP_M = 0.3  # a scan costs as much as this much way
SAME_SIDE_RAD = math.radians(30.0)  # looks at a place from so near the same side are one
NEARER = 0.6  # unless it is this much nearer
THERE_CELLS = 0.75  # a scan so near to a cell's centre was taken from it
SIGHT_M = 4.0  # unseen ground is not counted on from farther away
PITCH_M = 0.4  # places compared lie this far apart
BATCH = 150  # demands looked at together, nearest first: by the way as far as REACH_M
FINE_SIGHT_M, FINE_PITCH_M, FINE_BATCH = 6.0, 0.1, 40  # when nothing shows: through keyholes
NEAR_M = 5.0  # the least a scan must be expected to show grows with the way from there on
AREA_POWER = 0.7  # below 1: small pockets are closed while they are near
FAR_M = 2.0  # a place farther than this has others on the way to it
BESIDE_M = 0.5  # keyholes that need no longer detour are looked through on the way
BESIDE_PITCH_M, KEYHOLE_MIN_M2 = 0.2, 0.05
KEYHOLE_NEAR_M = 1.0  # of keyholes so near to such ground, axis by axis
REACH_M = 6.0  # places are looked for so far around first
WIDER = 2.0  # and then so many times as far at most
VIEW_MAX_M2 = 5.0  # places farther on are taken to show no more; few do (6.2 was seen)

_NONE = np.zeros((0, 2), np.int64)


class _Found(NamedTuple):
    """The aim, and what another one on the way to it would have to be worth for its detour."""

    aim: Aim
    to_beat: float


class Auto:
    """The place with the most expected new area for its way."""

    name = "auto"
    replan_m = math.inf  # until what it came for is seen: choosing anew each metre dithers
    reach_m = REACH_M

    def __init__(self, *, is_alone: bool = True) -> None:
        """Without others that do the rest, `is_alone`, it also looks through keyholes."""
        self._is_alone = is_alone

    def aim(self, outlook: Outlook) -> Aim | None:
        """None when no place shows anything unseen.

        Looks farther around while a place there could be better.
        """
        times = max(1, round(CELL_M / outlook.resolution_m))
        while True:
            found = self._found(coarsened(outlook, times) if times > 1 else outlook)
            asked_m = _better_within_m(found)
            if outlook.wider is None or asked_m <= outlook.limit_m:
                break
            outlook = outlook.wider(min(asked_m, WIDER * outlook.limit_m))
        if found is None:
            return None
        return refined(outlook, found.aim, times) if times > 1 else found.aim

    def _found(self, outlook: Outlook) -> _Found | None:
        demands = demands_of(outlook, np.concatenate([_NONE, *outlook.edges]))
        found = _look(outlook, demands, PITCH_M, SIGHT_M, BATCH)
        if not self._is_alone:
            return found
        if found is not None:
            return _keyhole_before(outlook, found)
        edges = np.concatenate([_NONE, *outlook.edges, *outlook.short_edges])
        demands = demands_of(outlook, edges)
        return _look(outlook, demands, FINE_PITCH_M, FINE_SIGHT_M, FINE_BATCH)


def _better_within_m(found: _Found | None) -> float:
    """No place to which the way is dearer than this can be worth more."""
    return math.inf if found is None else VIEW_MAX_M2**AREA_POWER / found.aim.worth - STOP_M


def _look(
    outlook: Outlook, demands: Demands, pitch_m: float, sight_m: float, batch: int
) -> _Found | None:
    """The best of places so far apart, for the nearest demands that show from any."""
    pitch = max(1, round(pitch_m / outlook.resolution_m))
    places, near_m = _places(outlook, pitch)
    if len(places) == 0:
        return None
    edge = demands.edge_cells // pitch
    way_m = near_m[edge[:, 0], edge[:, 1]]
    away_m = np.hypot(*(demands.edge_cells - outlook.here).T) * outlook.resolution_m
    order = np.argsort(np.where(way_m <= REACH_M, way_m, REACH_M + away_m), kind="stable")
    for first in range(0, len(order), batch):
        found = _best(outlook, places, demands.part(order[first : first + batch]), sight_m)
        if found is not None:
            return found
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Views:
    """What places (P, 2) show of the demands, without what was looked at in vain: (P, D)."""

    places: IndexArray
    demands: Demands
    shows: BoolArray

    def aim(self, place: int, worth: float) -> Aim:
        """One of the places as an aim."""
        area_m2 = float(self.shows[place] @ self.demands.area_m2)
        shown = np.flatnonzero(self.shows[place])
        shown = shown[np.argsort(-self.demands.area_m2[shown], kind="stable")]
        return Aim(
            cell=(int(self.places[place, 0]), int(self.places[place, 1])),
            targets=self.demands.edge_cells[shown],
            why=f"{area_m2:.1f} m2 in view",
            heeds_looks=True,
            worth=worth,
        )


def _best(
    outlook: Outlook, places: IndexArray, demands: Demands, sight_m: float
) -> _Found | None:
    """The best of places (P, 2) for some demands; None when none of them shows from any."""
    reach = round(sight_m / outlook.resolution_m)
    low, high = demands.cells.min(axis=0) - reach, demands.cells.max(axis=0) + reach
    places = places[((places >= low) & (places <= high)).all(axis=1)]
    if len(places) == 0:
        return None
    views = _views(outlook, places, demands, sight_m)
    way_m = outlook.cost_m[places[:, 0], places[:, 1]]
    worth = _worth(views.shows @ demands.area_m2, way_m, outlook.gain_min_m2)
    best = int(worth.argmax())
    if worth[best] == 0.0:
        return None
    first, to_beat = best, float(worth[best])
    if way_m[best] > FAR_M and not outlook.looks_on_the_way:
        detour_m = _detours_m(outlook, tuple(places[best].tolist()))
        detour_m = detour_m[places[:, 0], places[:, 1]]
        first, to_beat = _before(views, best, to_beat, detour_m, outlook.gain_min_m2)
    return _Found(views.aim(first, float(worth[best])), to_beat)


def _worth(area_m2: FloatArray, way_m: FloatArray, gain_min_m2: float) -> FloatArray:
    """(P,) what is to be seen for the way; 0 where it is less than a scan must show."""
    is_worth = np.isfinite(way_m)
    is_worth &= area_m2 > np.where(is_worth, gain_min_m2 * np.maximum(1.0, way_m / NEAR_M), 0.0)
    return np.asarray(is_worth * area_m2**AREA_POWER / (STOP_M + way_m))


def _before(
    views: _Views, best: int, worth: float, detour_m: FloatArray, gain_min_m2: float
) -> tuple[int, float]:
    """The place to look from before one is gone to, and what that is worth; or that one.

    What it shows that the other does not counts, for the detour (P,) alone.
    """
    beside_m2 = (views.shows & ~views.shows[best]) @ views.demands.area_m2
    for_detour = _worth(beside_m2, detour_m, gain_min_m2)
    first = int(for_detour.argmax())
    return (first, float(for_detour[first])) if for_detour[first] > worth else (best, worth)


def _detours_m(outlook: Outlook, cell: tuple[int, int]) -> FloatArray:
    """(H, W) how much longer the way to a cell is by each other one; inf: there is none."""
    on_m, _ = wave(outlook.factor, cell, outlook.resolution_m)
    return np.asarray(np.maximum(outlook.cost_m + on_m - outlook.cost_m[cell], 0.0))


def _keyhole_before(outlook: Outlook, found: _Found) -> _Found:
    """A place right beside the way that looks through a keyhole; else what was found."""
    cell = found.aim.cell
    if outlook.looks_on_the_way or outlook.cost_m[cell] <= FAR_M:
        return found
    detour_m = _detours_m(outlook, cell)
    places = set_cells(detour_m <= BESIDE_M)
    places = places[(places % round(BESIDE_PITCH_M / outlook.resolution_m) == 0).all(axis=1)]
    edges = np.concatenate([_NONE, *outlook.edges, *outlook.short_edges])
    size = 2 * round(KEYHOLE_NEAR_M / outlook.resolution_m) + 1
    near_m = minimum_filter(detour_m, size=size)[edges[:, 0], edges[:, 1]]
    demands = demands_of(outlook, edges[near_m <= BESIDE_M])
    if len(demands.cells) == 0:
        return found
    views = _views(outlook, np.concatenate([places, [cell]]), demands, FINE_SIGHT_M)
    detour_m = detour_m[views.places[:, 0], views.places[:, 1]]
    last = len(places)
    first, to_beat = _before(views, last, found.to_beat, detour_m, KEYHOLE_MIN_M2)
    return found if first == last else _Found(views.aim(first, found.aim.worth), to_beat)


def _views(outlook: Outlook, places: IndexArray, demands: Demands, sight_m: float) -> _Views:
    reach = round(sight_m / outlook.resolution_m)
    low, high = demands.cells.min(axis=0) - reach, demands.cells.max(axis=0) + reach
    nodes, at = _looks_near(outlook, low, high)
    seen = shows_from(outlook, np.concatenate([places, at]), demands.cells, sight_m)
    shows, was_seen = seen[: len(places)], seen[len(places) :]
    _count_looks_from(places, outlook.looks.cells[nodes], shows, was_seen)
    _drop_looked_at(outlook.looks.part(nodes), was_seen, places, demands.cells, shows)
    return _Views(places=places, demands=demands, shows=shows)


def _count_looks_from(
    places: IndexArray, look_cells: FloatArray, shows: BoolArray, was_seen: BoolArray
) -> None:
    """A look from a place should have shown all that shows from there; into `was_seen` (K, D).

    The robot stands a bit beside the cell's centre, perhaps in the next one, from which a
    keyhole shows less; that cell looked at in vain would be aimed at again and again.
    """
    place, look = pairs_near(places, np.floor(look_cells).astype(np.int64), 1)
    off = places[place] + 0.5 - look_cells[look]
    is_there = np.hypot(off[:, 0], off[:, 1]) <= THERE_CELLS
    np.logical_or.at(was_seen, look[is_there], shows[place[is_there]])


def _looks_near(
    outlook: Outlook, low: IndexArray, high: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Numbers (K,) and cells (K, 2) of the looks from within a box of cells."""
    cells = np.floor(outlook.looks.cells).astype(np.int64)
    nodes = np.flatnonzero(((cells >= low) & (cells <= high)).all(axis=1))
    return nodes, cells[nodes]


def _drop_looked_at(
    looks: PastLooks,
    was_seen: BoolArray,
    places: IndexArray,
    cells: IndexArray,
    shows: BoolArray,
) -> None:
    """Of what `shows` (P, D), drop what has been looked at in vain much as from there.

    From the same side and hardly farther away: what hid it then will hide it again. `was_seen`
    (K, D) says what should have shown from the looks.
    """
    cell, node = set_cells(was_seen.T).T
    ahead = cells[cell] + 0.5 - looks.cells[node]
    off = np.arctan2(ahead[:, 0], ahead[:, 1]) - looks.towards_rad[node]
    was_turned_to = np.abs(wrap_rad(off)) < looks.half_rad[node]
    cell, old = cell[was_turned_to], ahead[was_turned_to]
    counts = np.bincount(cell, minlength=len(cells))
    place, shown = set_cells(shows).T
    pair = np.repeat(np.arange(len(place)), counts[shown])  # each with all looks at its cell
    nth = np.arange(len(pair)) - np.repeat(np.cumsum(counts[shown]), counts[shown])
    old = old[nth + np.cumsum(counts)[shown[pair]]]
    new = (cells[shown] - places[place])[pair]
    far, was_far = np.hypot(*new.T), np.hypot(*old.T)
    along = new[:, 0] * old[:, 0] + new[:, 1] * old[:, 1]
    same = (along >= math.cos(SAME_SIDE_RAD) * far * was_far) & (far >= NEARER * was_far)
    shows[place[pair[same]], shown[pair[same]]] = False


def _places(outlook: Outlook, pitch: int) -> tuple[IndexArray, np.ndarray]:
    """(P, 2) of each block of cells the reachable one nearest to its middle; cost by block."""
    height, width = outlook.cost_m.shape
    margins = [(0, -height % pitch), (0, -width % pitch)]
    cost = np.pad(outlook.cost_m, margins, constant_values=np.inf)
    rows, cols = cost.shape[0] // pitch, cost.shape[1] // pitch
    in_blocks = cost.reshape(rows, pitch, cols, pitch).transpose(0, 2, 1, 3)
    blocks = in_blocks.reshape(rows, cols, pitch * pitch)
    off = np.abs(np.arange(pitch) - 0.5 * (pitch - 1))
    middle = (off[:, None] + off).reshape(-1)
    is_open = np.isfinite(blocks)
    chosen = np.where(is_open, middle, np.inf).argmin(axis=2)
    block = set_cells(np.any(is_open, axis=2))
    inner = np.stack(np.divmod(chosen[block[:, 0], block[:, 1]], pitch), axis=-1)
    return block * pitch + inner, blocks.min(axis=2)
