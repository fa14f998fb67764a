# SPDX-License-Identifier: MIT
"""A robot in the world of the published baselines: strategies there see what those saw.

Ground is free cells farther than the radius from known walls; the way is the 8-connected
shortest one, not pulled straight. `stop` scans at the goal, `enroute` every 0.2 m, choosing
anew each metre. Ends at 99 % of what can be seen, or when nothing is left to go to.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from exploration_study.reference_explorer import GapsOnReferenceGrid
from exploration_study.reference_grid import (
    CELL_M,
    FREE,
    OCCUPIED,
    PAD,
    RANGE_M,
    UNKNOWN,
    Cell,
    ReferenceGrid,
)
from exploration_study.track import MARKS, Pace, Track
from ins_robot.navigation.frontiers import NearestFrontier
from ins_robot.navigation.outlook import Aim, Outlook
from ins_robot.navigation.strategies import PlaceChooser
from ins_robot.navigation.wave import wave

PACE = Pace(speed_mps=0.2, scan_s=3.0)
EDGE_CELLS = 3  # shorter edges are not looked at
REACH_CELLS = 3
RETRIES = 3
SCAN_EVERY_CELLS = 2
PATH_MAX_M = 5000.0
EIGHT = np.ones((3, 3), int)
MARGIN_CELLS = 60  # unseen ground within range that a strategy may count


class ReferenceRobot:
    """One run; `explore` yields its track after each decision."""

    def __init__(
        self, grid: ReferenceGrid, strategy: PlaceChooser | GapsOnReferenceGrid, mode: str
    ) -> None:
        self.grid, self.strategy, self.mode = grid, strategy, mode
        self.known = np.zeros_like(grid.truth)
        self.cell = grid.start
        self.track = Track(PACE)
        self._is_ignored = np.zeros(grid.truth.shape, bool)
        self._was_driven = np.zeros(grid.truth.shape, bool)
        self._heading_rad: float | None = None

    def explore(self) -> Iterator[Track]:
        """Scan, choose, go."""
        self._scan(is_stop=True)
        fallback, retries = NearestFrontier(), 0
        while not self._is_done():
            begun = time.process_time()
            corner, outlook = self._outlook()
            if retries:
                chosen = fallback.aim(outlook)
            elif isinstance(self.strategy, GapsOnReferenceGrid):
                chosen = self.strategy.aim_from(self.cell, self.known, corner, outlook)
            else:
                chosen = self.strategy.aim(outlook)
            if chosen is None:
                if retries == RETRIES or not self._is_ignored.any():
                    break
                self._is_ignored[:] = False
                retries += 1
                continue
            self.track.decide_ms.append(1e3 * (time.process_time() - begun))
            self._go(corner, chosen, outlook)
            yield self.track
        self.track.end = "99 % seen" if self._is_done() else "nothing left to go to"
        if self.track.coverage < max(MARKS):
            self.track.failure = f"{self.track.coverage:.4f} seen: {self.track.end}"
        self.track.home_m = self._home_m()
        yield self.track

    def _is_done(self) -> bool:
        return self.track.coverage >= max(MARKS) or self.track.path_m >= PATH_MAX_M

    def _scan(self, *, is_stop: bool) -> None:
        self.grid.scan(self.cell, self.known)
        self.track.stops += is_stop
        self.track.saw(self.grid.coverage(self.known))

    def _outlook(self) -> tuple[Cell, Outlook]:
        """What the strategy sees, and where its cell (0, 0) lies."""
        rows, cols = (np.flatnonzero((self.known != UNKNOWN).any(axis=a)) for a in (1, 0))
        height, width = self.known.shape
        first = max(rows[0] - MARGIN_CELLS, PAD - 1), max(cols[0] - MARGIN_CELLS, PAD - 1)
        window = (
            slice(first[0], min(rows[-1] + MARGIN_CELLS, height - PAD) + 1),
            slice(first[1], min(cols[-1] + MARGIN_CELLS, width - PAD) + 1),
        )
        known = self.known[window]
        here = self.cell[0] - first[0], self.cell[1] - first[1]
        is_open = self._ground(known, here, window)
        factor = np.where(is_open, 1.0, np.inf)
        cost, before = wave(factor, here, CELL_M)
        self._is_open = is_open
        is_edge = (known == FREE) & ndimage.binary_dilation(known == UNKNOWN)
        labels, _ = ndimage.label(is_edge & ~self._is_ignored[window], EIGHT)
        long, short = edges_of(labels)
        outlook = Outlook(
            resolution_m=CELL_M,
            range_m=RANGE_M,
            is_unseen=known == UNKNOWN,
            is_opaque=known == OCCUPIED,
            factor=factor,
            cost_m=cost,
            before=before,
            here=here,
            edges=long,
            short_edges=short,
            reach_cells=REACH_CELLS,
            looks_on_the_way=self.mode == "enroute",
        )
        return (int(first[0]), int(first[1])), outlook

    def _ground(
        self, known: NDArray[np.uint8], here: Cell, window: tuple[slice, slice]
    ) -> NDArray[np.bool_]:
        """Where the body fits.

        For a robot in fresh inflation also free cells off the walls around it, and where it
        came from: without that 1 of 28 runs was locked in.
        """
        is_wall = known == OCCUPIED
        is_open = (known == FREE) & ~ndimage.binary_dilation(is_wall, self.grid.body)
        if not is_open[here]:
            (row, col), reach = here, len(self.grid.body)
            around = (
                slice(max(row - reach, 0), row + reach + 1),
                slice(max(col - reach, 0), col + reach + 1),
            )
            off_walls = (known == FREE) & ~ndimage.binary_dilation(is_wall)
            is_open[around] |= off_walls[around]
            is_open |= self._was_driven[window]
            is_open[here] = True
        return is_open

    def _go(self, corner: Cell, chosen: Aim, outlook: Outlook) -> None:
        """Along the way to the chosen place, as the mode says; scan there."""
        way = outlook.way_to(chosen.cell)
        cells = [(row + corner[0], col + corner[1]) for row, col in way.tolist()]
        targets = chosen.targets + np.array(corner)
        target = targets[0]
        unseen_before = int((self.known == UNKNOWN).sum())
        moved_m = 0.0
        for number, (last, cell) in enumerate(pairwise(cells), start=1):
            if self._is_blocked(cell, corner):
                break
            moved_m += self._step(last, cell)
            if self.mode == "enroute" and number % SCAN_EVERY_CELLS == 0:
                self._scan(is_stop=False)
                if self._is_done() or not self._around(target, UNKNOWN):
                    break
                if moved_m >= self.strategy.replan_m:
                    break
        if self.cell == cells[-1] or self.mode == "stop":
            self._scan(is_stop=self.mode == "stop")
        if int((self.known == UNKNOWN).sum()) == unseen_before:  # in vain: never again
            self._is_ignored[targets[:, 0], targets[:, 1]] = True
            if moved_m == 0.0:
                row, col = target
                self._is_ignored[row - 2 : row + 3, col - 2 : col + 3] = True

    def _is_blocked(self, cell: Cell, corner: Cell) -> bool:
        if self.known[cell] != FREE:
            return True
        inside = cell[0] - corner[0], cell[1] - corner[1]
        return (
            self.mode == "enroute"
            and not self._is_open[inside]
            and self._around(np.array(cell), OCCUPIED)
        )

    def _around(self, cell: NDArray[np.int64], state: int) -> bool:
        row, col = cell
        return bool((self.known[row - 1 : row + 2, col - 1 : col + 2] == state).any())

    def _step(self, last: Cell, cell: Cell) -> float:
        length_m = CELL_M * math.hypot(cell[0] - last[0], cell[1] - last[1])
        heading = math.atan2(cell[0] - last[0], cell[1] - last[1])
        if self._heading_rad is not None:
            off = abs(heading - self._heading_rad)
            self.track.turning_rad += min(off, 2.0 * math.pi - off)
        self._heading_rad = heading
        self._was_driven[cell] = True
        self.track.path_m += length_m
        self.cell = cell
        return length_m

    def _home_m(self) -> float | None:
        """Length of the way back to the start over known ground."""
        corner, outlook = self._outlook()
        start = self.grid.start[0] - corner[0], self.grid.start[1] - corner[1]
        cost = float(outlook.cost_near_m[start])
        return cost if math.isfinite(cost) else None


Edges = tuple[NDArray[np.int64], ...]


def edges_of(labels: NDArray[np.int32]) -> tuple[Edges, Edges]:
    """Cells (n, 2) of each label: of those that are long enough, and of the others."""
    cells = np.argwhere(labels)
    names = labels[cells[:, 0], cells[:, 1]]
    order = np.argsort(names, kind="stable")
    cuts = np.flatnonzero(np.diff(names[order])) + 1
    parts = np.split(cells[order], cuts) if len(cells) else []
    is_long = [len(part) >= EDGE_CELLS for part in parts]
    return (
        tuple(part for part, ok in zip(parts, is_long, strict=True) if ok),
        tuple(part for part, ok in zip(parts, is_long, strict=True) if not ok),
    )
