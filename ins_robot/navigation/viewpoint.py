# SPDX-License-Identifier: MIT
"""The place to scan a gap from: reachable, near its anchor, and with a view of what is new.

Standing in the opening is best. Where the body does not fit, or must not reach into unseen
ground, the nearest reachable place that looks in will do. Never right at a wall if there is
room, and not where a scan was taken already if there is another place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.ray_cast import cast_rays, cells_on_rays
from ins_robot.navigation.sight import sees
from ins_robot.navigation.terrain import BoolArray, IndexArray, Terrain

NEAR_M = 1.2  # from the anchor, where the place is looked for first
PEEK_M = 4.0  # how far away a place may be that only looks in
PEEK_RAYS = 120
PEEK_TARGETS = 2  # targets from which such places are looked for
PEEKS = 16  # places compared for one target, evenly drawn
TARGETS = 8  # edge cells a place is judged by
PLACES = 120  # places tried, best first
WALL_WEIGHT = 2.0  # metres of distance that a metre of missing room to a wall is worth
ROOM_M = 0.15  # room beyond the preferred clearance that is worth going for
USED_M = 0.2  # nearer than this to an earlier scan is the same place
USED_PENALTY_M = 1.0
COST_WEIGHT = 0.05  # metres of distance that a metre of way is worth
LOOK_MIN_M = 0.1  # nearer than this a direction says nothing

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewpoint:
    """Where to scan, and facing what."""

    cell: Cell
    heading_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """A gap to be looked into, map frame.

    `anchor_m` (2,) is where to stand if that can be: the centroid, or what is still unseen near
    it; `outward` (2,) points through the gap. `targets_m` (T, 2), T >= 1, is what the scan
    should show; `used_m` (U, 2) are places where scans were taken or goals given up.
    """

    anchor_m: FloatArray
    outward: FloatArray
    targets_m: FloatArray
    used_m: FloatArray

    @property
    def sample_m(self) -> FloatArray:
        """(S, 2) a few of the targets, evenly drawn."""
        count = len(self.targets_m)
        if count <= TARGETS:
            return self.targets_m
        return self.targets_m[np.linspace(0, count - 1, TARGETS).astype(np.int64)]


def near_viewpoint(terrain: Terrain, is_opaque: BoolArray, look: Look) -> Viewpoint | None:
    """The reachable place nearest to the anchor that looks into the gap."""
    cell = _best(terrain, is_opaque, _places_around(terrain, look.anchor_m), look)
    if cell is None:
        return None
    return Viewpoint(cell=cell, heading_rad=_facing(terrain, cell, look))


def peeks(
    terrain: Terrain, is_opaque: BoolArray, look: Look, gain: Callable[[Viewpoint], int]
) -> Iterator[Viewpoint]:
    """Reachable places that look in from afar, those first that show most for their way.

    `gain` tells how many unseen cells a scan may show.
    """
    targets = look.sample_m
    for target in targets[:: max(1, len(targets) // PEEK_TARGETS)]:
        places = _places_in_view(terrain, is_opaque, target)
        if len(places) > PEEKS:
            places = places[np.linspace(0, len(places) - 1, PEEKS).astype(np.int64)]
        found = []
        for row, col in places.tolist():
            peek = Viewpoint(cell=(row, col), heading_rad=_facing(terrain, (row, col), look))
            worth = gain(peek) / (1.0 + COST_WEIGHT * float(terrain.cost_m[row, col]))
            found.append((-worth, (row, col), peek))
        yield from (peek for _, _, peek in sorted(found, key=lambda item: item[:2]))


def _places_around(terrain: Terrain, point_m: FloatArray) -> IndexArray:
    """(N, 2) reachable cells within NEAR_M of a point."""
    row, col = terrain.grid.cells(point_m)
    reach = math.ceil(NEAR_M / terrain.grid.resolution_m)
    first = np.array([max(int(row) - reach, 0), max(int(col) - reach, 0)])
    window = terrain.cost_m[
        first[0] : max(int(row) + reach + 1, 0), first[1] : max(int(col) + reach + 1, 0)
    ]
    cells = np.argwhere(np.isfinite(window)) + first
    away = np.hypot(*(terrain.grid.metres(cells) - point_m).T)
    return np.asarray(cells[away <= NEAR_M])


def _places_in_view(terrain: Terrain, is_opaque: BoolArray, target_m: FloatArray) -> IndexArray:
    """(N, 2) reachable cells that see a point."""
    grid = terrain.grid
    start = (np.asarray(target_m) - np.array(grid.origin_m))[::-1][None] / grid.resolution_m
    bearings = np.linspace(-math.pi, math.pi, PEEK_RAYS, endpoint=False)
    reach = PEEK_M / grid.resolution_m
    distance = np.minimum(cast_rays(is_opaque, start, bearings, reach), reach)
    flat, _ = cells_on_rays(is_opaque.shape, start, bearings, distance)
    flat = np.unique(flat)
    flat = flat[np.isfinite(terrain.cost_m.reshape(-1)[flat])]
    return np.stack(np.divmod(flat, is_opaque.shape[1]), axis=-1)


def _best(
    terrain: Terrain, is_opaque: BoolArray, places: IndexArray, look: Look
) -> Cell | None:
    """Of the places that see about as many targets as any, the one nearest to the anchor."""
    if len(places) == 0:
        return None
    points = terrain.grid.metres(places)
    at = places[:, 0], places[:, 1]
    wanted = terrain.body.radius_m + terrain.body.clearance_m + ROOM_M
    score = np.hypot(*(points - look.anchor_m).T)
    score += WALL_WEIGHT * np.clip(wanted - terrain.clearance_m[at], 0.0, None)
    score += COST_WEIGHT * terrain.cost_m[at]
    middle, reach = points.mean(axis=0), np.hypot(*np.ptp(points, axis=0)) + USED_M
    used = look.used_m[np.hypot(*(look.used_m - middle).T) < reach]
    if len(used):
        away = points[:, None] - used[None]
        score += USED_PENALTY_M * (np.hypot(away[..., 0], away[..., 1]).min(axis=1) < USED_M)
    order = np.argsort(score, kind="stable")
    if len(order) > PLACES:  # the best third, and the rest drawn evenly
        first = PLACES // 3
        rest = np.linspace(first, len(order) - 1, PLACES - first).astype(np.int64)
        order = np.concatenate([order[:first], order[rest]])
    origin, resolution = np.array(terrain.grid.origin_m), terrain.grid.resolution_m
    targets = np.asarray((look.sample_m - origin)[:, ::-1] / resolution)
    starts = np.asarray(places[order] + 0.5, dtype=np.float64)
    seen = sees(is_opaque, starts, targets).sum(axis=1)
    if seen.max() == 0:
        return None
    chosen = order[int(np.flatnonzero(2 * seen >= seen.max())[0])]
    return int(places[chosen, 0]), int(places[chosen, 1])


def _facing(terrain: Terrain, cell: Cell, look: Look) -> float:
    """Towards the middle of the targets; through the gap when standing on it."""
    ahead = look.targets_m.mean(axis=0) - terrain.grid.metres(np.array(cell))
    if math.hypot(*ahead) < LOOK_MIN_M:
        ahead = look.outward
    return math.atan2(ahead[1], ahead[0])
