# SPDX-License-Identifier: MIT
"""Where the robot can drive, and what it costs to get there: one wave for a whole decision.

Drivable is what is known to be free, far enough from walls for the body, and not so near to
unseen cells that the body would reach into them. The way costs more near walls, so that it
keeps clear of them where there is room, and much more below the preferred clearance, so that a
narrow door is taken only where it is needed. One Dijkstra wave from the robot prices all cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.neighbourhood import grown
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.wave import wave

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.int64]

MARGIN_CELLS = 1.0 / 3.0  # least clearance: covers the corners of cells the way runs between
EASE_M = 0.25  # beyond the preferred clearance the cost still falls over this length
EASE_WEIGHT = 1.0  # a cell at the preferred clearance costs this much more than open ground
TIGHT_FACTOR = 3.0  # below the preferred clearance ground costs this many times as much
ESCAPE_FACTOR = 8.0  # ground inside fresh inflation, open only around the robot
ESCAPE_M = 0.15  # how far past its own radius the robot may have to escape


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyRules:
    """What the body needs."""

    radius_m: float
    clearance_m: float

    @property
    def keep_m(self) -> float:
        """From the centre to a line that must not be crossed."""
        return self.radius_m + self.clearance_m

    @property
    def wide_m(self) -> float:
        """Farther from walls than this is as good as anywhere."""
        return self.keep_m + EASE_M


@dataclass(frozen=True, slots=True, kw_only=True)
class OddCells:
    """Cells to be driven at a certain place instead of their centre.

    `cells` (M, 2) int64 and `places_m` (M, 2) float64, map frame.
    """

    cells: IndexArray
    places_m: FloatArray

    @staticmethod
    def none() -> OddCells:
        """No such cell."""
        return OddCells(cells=np.zeros((0, 2), np.int64), places_m=np.zeros((0, 2)))

    def joined(self, other: OddCells) -> OddCells:
        """Both; where both name a cell, this one counts."""
        return OddCells(
            cells=np.concatenate([self.cells, other.cells]),
            places_m=np.concatenate([self.places_m, other.places_m]),
        )

    def kept(self, keep: BoolArray) -> OddCells:
        """Some of them, by mask (M,)."""
        return OddCells(cells=self.cells[keep], places_m=self.places_m[keep])


@dataclass(frozen=True, slots=True, kw_only=True)
class Terrain:
    """One decision's view of the ground.

    `odd` are cells open by exception (driven before, narrow passages), at a place in them.

    Attributes
    ----------
    start_cell : (row, col)
        The robot's.
    clearance_m : (H, W) float64
        From a cell's centre to the nearest face of an occupied cell.
    factor : (H, W) float64
        Cost per metre; inf where the robot must not be.
    cost_m : (H, W) float64
        Of the cheapest way from the robot; inf where there is none.
    before : (H, W) int32
        Flat index of the cell before, on that way; negative at the start and where none is.
    """

    grid: OccupancyGrid
    body: BodyRules
    start_cell: tuple[int, int]
    clearance_m: FloatArray
    factor: FloatArray
    cost_m: FloatArray
    before: NDArray[np.int32]
    odd: OddCells

    def places_m(self, cells: IndexArray) -> tuple[FloatArray, BoolArray]:
        """(N, 2) where to drive in cells (N, 2), and (N,) which of them are odd."""
        places = self.grid.metres(cells)
        width = self.cost_m.shape[1]
        odd_flat = self.odd.cells[:, 0] * width + self.odd.cells[:, 1]
        names, first = np.unique(odd_flat, return_index=True)
        flat = cells[:, 0] * width + cells[:, 1]
        if len(names) == 0:
            return places, np.zeros(len(cells), bool)
        at = np.minimum(np.searchsorted(names, flat), len(names) - 1)
        is_odd = names[at] == flat
        places[is_odd] = self.odd.places_m[first[at[is_odd]]]
        return places, is_odd

    @property
    def is_reachable(self) -> BoolArray:
        """(H, W) bool."""
        return np.isfinite(self.cost_m)

    def seen_from(self, place: Pose2) -> Terrain:
        """The same ground, priced from another place."""
        row, col = self.grid.cells(np.array([place.x_m, place.y_m]))
        start = (int(row), int(col))
        factor = self.factor.copy()
        _open_escape(factor, self.grid, self.clearance_m, self.body, start)
        cost, before = wave(factor, start, self.grid.resolution_m)
        return replace(self, start_cell=start, factor=factor, cost_m=cost, before=before)

    def cost_near_m(self, points_m: FloatArray, reach_cells: int = 3) -> FloatArray:
        """(N,) cheapest cost within a few cells of points (N, 2); inf where none is."""
        cells = self.grid.cells(points_m)
        offsets = np.arange(-reach_cells, reach_cells + 1)
        rows = cells[:, 0, None, None] + offsets[:, None]
        cols = cells[:, 1, None, None] + offsets[None, :]
        height, width = self.cost_m.shape
        inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        rows, cols = np.clip(rows, 0, height - 1), np.clip(cols, 0, width - 1)
        costs = np.where(inside, self.cost_m[rows, cols], np.inf)
        return np.asarray(costs.min(axis=(1, 2)))

    def way_to(self, cell: tuple[int, int]) -> IndexArray:
        """(N, 2) cells of the cheapest way from the robot to a reachable cell."""
        width = self.cost_m.shape[1]
        flat = [cell[0] * width + cell[1]]
        before = self.before.reshape(-1)
        while (previous := int(before[flat[-1]])) >= 0:
            flat.append(previous)
        return np.stack(np.divmod(np.array(flat[::-1]), width), axis=-1)


def survey_terrain(
    grid: OccupancyGrid,
    pose: Pose2,
    body: BodyRules,
    is_allowed: BoolArray | None = None,
    odd: OddCells | None = None,
    *,
    takes_quiet: bool = False,
    limit_m: float = math.inf,
) -> Terrain:
    """Price the ground as seen from a pose.

    Parameters
    ----------
    is_allowed : (H, W) bool, optional
        Where the robot's centre may be at all.
    odd : OddCells, optional
        Cells to open where they are closed, and where in them to drive.
    takes_quiet : bool
        Ground that silent beams crossed nearby counts as free: the last resort before a door
        behind which nothing answers.
    limit_m : float
        Ways that cost more are not looked for.
    """
    row, col = grid.cells(np.array([pose.x_m, pose.y_m]))
    start = (int(row), int(col))
    clearance = grid.clearance_m(body.wide_m)
    factor = _ground_factors(grid, clearance, body, takes_quiet)
    odd = _open_odd(factor, odd or OddCells.none())
    if is_allowed is not None:
        factor[~is_allowed] = np.inf
    _open_escape(factor, grid, clearance, body, start, is_allowed)
    cost, before = wave(factor, start, grid.resolution_m, limit_m)
    return Terrain(
        grid=grid,
        body=body,
        start_cell=start,
        clearance_m=clearance,
        factor=factor,
        cost_m=cost,
        before=before,
        odd=odd,
    )


def _ground_factors(
    grid: OccupancyGrid, clearance: FloatArray, body: BodyRules, takes_quiet: bool
) -> FloatArray:
    """(H, W) cost per metre of known free ground.

    The body must not reach into a single unknown cell: between two beams of a far scan stands
    the leg of a chair. Nearer than about 3 m the beams leave no cell out.
    """
    needed = body.radius_m + MARGIN_CELLS * grid.resolution_m
    preferred = max(needed, body.radius_m + body.clearance_m)
    factor = preferred + EASE_M - clearance  # in place from here on: the map may be large
    factor /= EASE_M
    np.clip(factor, 0.0, 1.0, out=factor)
    factor *= EASE_WEIGHT * factor
    factor += 1.0
    factor[clearance < preferred] *= TIGHT_FACTOR
    is_unknown, is_free = grid.is_unknown, grid.is_free
    if takes_quiet:
        is_free = is_free | (is_unknown & grid.is_quiet)
        is_unknown = is_unknown & ~grid.is_quiet
    is_open = is_free & (clearance >= needed)
    if is_unknown.any():
        doubt_m = grid.doubt_m(body.wide_m)
        if takes_quiet:
            is_doubtful = grown(is_unknown, corners=False) & ~grid.is_occupied
            doubt_m = distance_transform_edt(~is_doubtful, sampling=grid.resolution_m)
        is_open &= doubt_m - 0.5 * grid.resolution_m >= body.radius_m
    factor[~is_open] = np.inf
    return factor


def driven_cells(grid: OccupancyGrid, been_m: FloatArray, body: BodyRules) -> OddCells:
    """Where the robot's centre has been, at places (N, 2) densely.

    It can be there again, whatever later scans show around: they cannot lock the robot in.
    Unless an obstacle now stands clearly in the way.
    """
    half = 0.5 * grid.resolution_m  # to all sides, so that the cells join by their edges
    beside = half * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    odd = OddCells(
        cells=grid.cells((beside[:, None] + been_m).reshape(-1, 2)),
        places_m=np.tile(been_m, (len(beside), 1)),
    )
    odd = odd.kept(grid.contains(odd.cells))
    rows, cols = odd.cells[:, 0], odd.cells[:, 1]
    room = grid.clearance_m(body.wide_m)[rows, cols]
    is_clear = ~grid.is_occupied[rows, cols] & (room >= body.radius_m - grid.resolution_m)
    return odd.kept(is_clear)


def _open_odd(factor: FloatArray, odd: OddCells) -> OddCells:
    """Open the odd cells that are closed; returns those."""
    rows, cols = odd.cells[:, 0], odd.cells[:, 1]
    opened = odd.kept(~np.isfinite(factor[rows, cols]))
    factor[opened.cells[:, 0], opened.cells[:, 1]] = ESCAPE_FACTOR
    return opened


def _open_escape(
    factor: FloatArray,
    grid: OccupancyGrid,
    clearance: FloatArray,
    body: BodyRules,
    start: tuple[int, int],
    is_allowed: BoolArray | None = None,
) -> None:
    """Let the robot out when its own cell lies in what the last scan showed to be too near.

    Opens, around the robot only, known free cells that are no nearer to a wall than the robot
    is now; the robot's own cell always.
    """
    row, col = start
    height, width = factor.shape
    if not (0 <= row < height and 0 <= col < width) or math.isfinite(factor[row, col]):
        return
    reach = math.ceil((body.radius_m + ESCAPE_M) / grid.resolution_m)
    rows = slice(max(row - reach, 0), row + reach + 1)
    cols = slice(max(col - reach, 0), col + reach + 1)
    r, c = np.ogrid[rows, cols]
    r, c = r[: factor[rows, cols].shape[0]], c[:, : factor[rows, cols].shape[1]]
    disc = (r - row) ** 2 + (c - col) ** 2 <= reach * reach
    room = min(body.radius_m, float(clearance[row, col])) - 0.5 * grid.resolution_m
    opened = disc & grid.is_free[rows, cols] & (clearance[rows, cols] >= room)
    opened &= ~np.isfinite(factor[rows, cols])
    if is_allowed is not None:
        opened &= is_allowed[rows, cols]
    factor[rows, cols][opened] = ESCAPE_FACTOR
    factor[row, col] = ESCAPE_FACTOR
