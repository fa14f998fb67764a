# SPDX-License-Identifier: MIT
"""What a run of scans does to each cell, as one step: scans' evidence in, clamped sums out.

A clamped log-odds cell depends on the order of its evidence, but each addition is a map
x -> clip(x + shift, low, high), and so is any number of them one after the other. A part of
the map that did not move is therefore laid on whatever was drawn before it without looking
at its scans again. Evidence is counted in whole units, so that this is exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import MapConfig
from ins_robot.mapping.scan_footprint import ScanFootprint

UNIT = 2.0**-10  # of log-odds: exact in float32, and four times the clamp fits into int16

Steps = NDArray[np.int16]
Corner = tuple[int, int]


def limit_units(config: MapConfig) -> int:
    """The clamp."""
    return round(config.log_odds_max / UNIT)


def steps_of(footprint: ScanFootprint, config: MapConfig) -> Steps:
    """(H, W) what a scan adds to each cell, in units."""
    hit, miss = (np.float32(w / UNIT) for w in (config.hit_log_odds, config.miss_log_odds))
    evidence = footprint.evidence
    units = np.rint(evidence * np.where(evidence > 0.0, hit, miss))
    limit = 2 * limit_units(config)
    return np.asarray(np.clip(units, -limit, limit, out=units).astype(np.int16))


class EvidenceSums:
    """The evidence of scans one after the other, on a window that grows with them.

    Attributes
    ----------
    corner, end : (row, col)
        Lattice cells of the window's first cell and of the one past its last.
    """

    def __init__(self, config: MapConfig) -> None:
        self._config = config
        self._limit = limit_units(config)
        self.corner: Corner = (0, 0)
        self.end: Corner = (0, 0)
        self._shift = np.zeros((0, 0), np.int16)
        self._low, self._high = self._shift, self._shift
        self._is_quiet = np.zeros((0, 0), bool)

    def add(self, footprint: ScanFootprint) -> None:
        """Put a scan's evidence behind all that is there."""
        if footprint.evidence.size == 0:
            return
        self._grow_to(footprint)
        steps, limit = steps_of(footprint, self._config), self._limit
        window = self._window(footprint.corner, steps.shape)
        for sums, bound in ((self._shift, 2 * limit), (self._low, limit), (self._high, limit)):
            part = sums[window]
            part += steps
            np.clip(part, -bound, bound, out=part)
        self._is_quiet[window] |= footprint.is_quiet

    def lay_on(self, units: Steps, is_quiet: NDArray[np.bool_], corner: Corner) -> None:
        """Do to cells (H, W), whose first lies at `corner`, what the scans did."""
        first = [max(self.corner[i], corner[i]) for i in (0, 1)]
        last = [min(self.end[i], corner[i] + units.shape[i]) for i in (0, 1)]
        size = (last[0] - first[0], last[1] - first[1])
        if min(size) <= 0:
            return
        ours = self._window((first[0], first[1]), size)
        theirs = tuple(slice(first[i] - corner[i], last[i] - corner[i]) for i in (0, 1))
        cells = units[theirs]
        cells += self._shift[ours]
        np.maximum(cells, self._low[ours], out=cells)
        np.minimum(cells, self._high[ours], out=cells)
        is_quiet[theirs] |= self._is_quiet[ours]

    def _window(self, corner: Corner, size: tuple[int, ...]) -> tuple[slice, slice]:
        row, col = corner[0] - self.corner[0], corner[1] - self.corner[1]
        return slice(row, row + size[0]), slice(col, col + size[1])

    def _grow_to(self, footprint: ScanFootprint) -> None:
        corner, size = footprint.corner, footprint.evidence.shape
        end = (corner[0] + size[0], corner[1] + size[1])
        if self._shift.size == 0:
            self.corner = self.end = corner
        low = (min(self.corner[0], corner[0]), min(self.corner[1], corner[1]))
        high = (max(self.end[0], end[0]), max(self.end[1], end[1]))
        if (low, high) == (self.corner, self.end):
            return
        margins = [(self.corner[i] - low[i], high[i] - self.end[i]) for i in (0, 1)]
        limit = self._limit
        self._shift = np.pad(self._shift, margins)
        self._low = np.pad(self._low, margins, constant_values=-limit)
        self._high = np.pad(self._high, margins, constant_values=limit)
        self._is_quiet = np.pad(self._is_quiet, margins)
        self.corner, self.end = low, high
