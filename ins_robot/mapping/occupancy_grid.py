# SPDX-License-Identifier: MIT
"""Occupancy grid in log-odds: scans at known poses in, free, occupied and unknown cells out.

Cells are (row, col), row grows with +y; metres are (x, y); conversion happens only here. The
grid grows in blocks whose corners lie on one fixed lattice, so that grids built from the same
scans by other ways hold the same cells. Elfes (1989); Thrun, Burgard, Fox (2005), chapter 9.
What only navigation asks for imports its part of scipy then: 9 MB that a replay does without.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import MapConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.cell_states import (
    CROSSED_LOG_ODDS,
    KNOWN_LOG_ODDS,
    OCCUPIED_LOG_ODDS,
    solid,
    unknown,
)
from ins_robot.mapping.evidence_sums import UNIT, limit_units, steps_of
from ins_robot.mapping.kept_layer import Part
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.mapping.scan_footprint import ScanFootprint, draw_scan
from ins_robot.mapping.silence import Silence, SilenceRules, read_silence
from ins_robot.mapping.wall_distances import CLEARANCE_UP_TO_M, WallDistances
from ins_robot.mapping.wall_points import RINGS_M
from ins_robot.messages import LaserScan

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SEEN_TWICE = 1.2  # hits: once may be a ghost, which silence takes away again
BLOCK_CELLS = 64


class OccupancyGrid:
    """Log-odds of occupancy per cell; 0 where nothing is known.

    Attributes
    ----------
    resolution_m : float
        Edge of a cell.
    log_odds : (H, W) float32
        Clamped to +-`config.log_odds_max`. Replaced by a larger array when the grid grows.
    is_quiet : (H, W) bool
        Crossed by silent beams nearby: a doorway to a large room, or a glass door.
    origin_m : (x, y)
        Outer corner of cell (0, 0), in the map frame.
    distances : WallDistances
        Its distances to walls, and to what may be walled.
    """

    def __init__(self, resolution_m: float, config: MapConfig) -> None:
        self.resolution_m = resolution_m
        self.config = config
        self._corner = (0, 0)  # lattice (row, col) of cell (0, 0)
        self.log_odds: NDArray[np.float32] = np.zeros((BLOCK_CELLS, BLOCK_CELLS), np.float32)
        self._corner = (-BLOCK_CELLS // 2, -BLOCK_CELLS // 2)
        self.is_quiet = np.zeros(self.log_odds.shape, bool)
        self._distance_m: FloatArray | None = None
        self.distances = WallDistances()
        self._walls: cKDTree | None = None
        self._known_cells = 0

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.log_odds.shape[0], self.log_odds.shape[1]

    @property
    def corner(self) -> tuple[int, int]:
        """Lattice (row, col) of cell (0, 0): whole cells from the origin of the map frame."""
        return self._corner

    @property
    def origin_m(self) -> tuple[float, float]:
        """Outer corner (x, y) of cell (0, 0), in the map frame."""
        return self._corner[1] * self.resolution_m, self._corner[0] * self.resolution_m

    def cells(self, points_m: FloatArray) -> IntArray:
        """(..., 2) cells (row, col) that hold the points (..., 2); may lie outside the grid."""
        lattice = np.floor(np.asarray(points_m, float) / self.resolution_m).astype(np.int64)
        return lattice[..., ::-1] - self._corner

    def metres(self, cells: IntArray) -> FloatArray:
        """(..., 2) centres (x, y) of cells (..., 2)."""
        lattice = np.asarray(cells, dtype=np.float64) + self._corner + 0.5
        return lattice[..., ::-1] * self.resolution_m

    def contains(self, cells: IntArray) -> BoolArray:
        """(...) bool: which cells (..., 2) lie inside the grid."""
        cells = np.asarray(cells)
        rows, cols = cells[..., 0], cells[..., 1]
        height, width = self.shape
        return np.asarray((rows >= 0) & (rows < height) & (cols >= 0) & (cols < width))

    def log_odds_at(self, points_m: FloatArray) -> FloatArray:
        """(...) log-odds at points (..., 2); 0 outside, where all is unknown."""
        cells = self.cells(points_m)
        inside = self.contains(cells)
        values = np.zeros(inside.shape)
        values[inside] = self.log_odds[cells[inside][:, 0], cells[inside][:, 1]]
        return values

    @property
    def known_m2(self) -> float:
        """Area of the cells that are free or occupied."""
        return self._known_cells * self.resolution_m**2

    @property
    def is_occupied(self) -> BoolArray:
        """(H, W) bool."""
        return self.log_odds > OCCUPIED_LOG_ODDS

    @property
    def is_free(self) -> BoolArray:
        """(H, W) bool."""
        return self.log_odds < -KNOWN_LOG_ODDS

    @property
    def is_unknown(self) -> BoolArray:
        """(H, W) bool: neither free nor occupied."""
        return unknown(self.log_odds)

    @property
    def is_solid(self) -> BoolArray:
        """(H, W) bool: occupied, or unknown right beside it.

        What was hit goes on behind the face that was seen; nobody has seen how far. Not where
        a silent beam has passed: no wall ends there.
        """
        return solid(self.log_odds, self.is_quiet)

    def distance_m(self) -> FloatArray:
        """(H, W) Euclidean distance to the nearest solid cell; inf when there is none.

        Cached until the grid changes; the array is read-only.
        """
        if self._distance_m is None:
            from scipy.ndimage import distance_transform_edt

            solid = self.is_solid
            if solid.any():
                distance = distance_transform_edt(~solid, sampling=self.resolution_m)
            else:
                distance = np.full(self.shape, np.inf)
            distance.flags.writeable = False
            self._distance_m = distance
        return self._distance_m

    def walls(self) -> cKDTree:
        """Points (N, 2) on what is solid, map frame: near readings, else cells' corners.

        Cached until the grid changes.
        """
        if self._walls is None:
            self._walls = self.distances.walls_within(self, self._whole)
        return self._walls

    def walls_near(self, points_m: FloatArray) -> cKDTree:
        """Those no farther than WALLS_NEAR_M from points (N, 2), and some more."""
        return self.distances.walls_near(self, points_m)

    @property
    def _whole(self) -> Part:
        return slice(0, self.shape[0]), slice(0, self.shape[1])

    def clearance_m(self, up_to_m: float = CLEARANCE_UP_TO_M) -> FloatArray:
        """(H, W) from a cell's centre to the nearest solid surface, up to `up_to_m` or more.

        Told by readings where somebody may drive, by cells where nobody can have been. Only
        what has changed is worked out again; the array is read-only.
        """
        return self.distances.clearance_m(self, self._whole, up_to_m)

    def doubt_m(self, up_to_m: float = CLEARANCE_UP_TO_M) -> FloatArray:
        """(H, W) between a cell's centre and the nearest centre of one that may be walled.

        A wall that nobody has hit yet may run through the last free cell before the unknown.
        Up to `up_to_m` or more; only what has changed is worked out again; read-only.
        """
        return self.distances.doubt_m(self, self._whole, up_to_m)

    def integrate(
        self, scan: LaserScan, map_from_lrf: Pose2, range_trusted_m: float
    ) -> ScanFootprint:
        """Add one scan: each cell takes at most one hit or one miss; a hit beats a miss.

        `range_trusted_m` and `map.silent_free_m` bound what silent beams may free. Returns what
        was drawn.
        """
        footprint = self.footprint_of(scan, map_from_lrf, range_trusted_m)
        self.add(footprint)
        self.keep_readings(scan, map_from_lrf)
        return footprint

    def footprint_of(
        self,
        scan: LaserScan,
        map_from_lrf: Pose2,
        range_trusted_m: float,
        wall_m: FloatArray | None = None,
    ) -> ScanFootprint:
        """What one scan would add.

        Silence ends before the walls known here, or at `wall_m` (B,) if those are given.
        """
        rules = SilenceRules(
            near_m=min(range_trusted_m, self.config.silent_free_m),
            trusted_m=range_trusted_m,
            wide_rad=math.radians(self.config.silent_wide_deg),
        )
        silence = read_silence(scan, rules)
        if wall_m is None and silence.free_m.any() and not silence.is_proof:
            wall_m = self._wall_m(scan, silence, map_from_lrf, range_trusted_m)
        return draw_scan(
            scan,
            map_from_lrf,
            self.resolution_m,
            silence,
            wall_m,
            self.config.beam_max_m,
        )

    def keep_readings(self, scan: LaserScan, map_from_lrf: Pose2) -> None:
        """What a scan knows of walls, finer than cells."""
        self.distances.near.add(scan, map_from_lrf)
        reach = math.ceil(RINGS_M[-1] / self.resolution_m) + 1
        row, col = (self.cells(map_from_lrf.as_array()[:2]) + self._corner - reach).tolist()
        self._forget((row, col), (2 * reach + 1, 2 * reach + 1))

    def _wall_m(
        self, scan: LaserScan, silence: Silence, map_from_lrf: Pose2, reach_m: float
    ) -> FloatArray:
        """(B,) known walls ahead of beams whose silence tells of something; inf for others."""
        beams = np.flatnonzero(silence.free_m)
        wall_m = np.full(len(silence.free_m), np.inf)
        bearings = scan.bearings_rad[beams] + map_from_lrf.heading_rad
        at = np.array([map_from_lrf.y_m, map_from_lrf.x_m]) / self.resolution_m
        reach = math.ceil(reach_m / self.resolution_m) + 1
        corner = np.floor(at).astype(np.int64) - reach
        is_wall = self._walls_in(corner, 2 * reach + 1)
        walls = cast_rays(is_wall, (at - corner)[None], bearings, float(reach))
        wall_m[beams] = walls * self.resolution_m
        return wall_m

    def _walls_in(self, corner: IntArray, size: int) -> BoolArray:
        """(size, size) bool: what was hit more than once in a lattice window; none beyond."""
        window = np.zeros((size, size), bool)
        row, col = (corner - self._corner).tolist()
        height, width = self.shape
        rows = slice(max(row, 0), max(min(row + size, height), 0))
        cols = slice(max(col, 0), max(min(col + size, width), 0))
        known = self.log_odds[rows, cols] > SEEN_TWICE * self.config.hit_log_odds
        top, left = rows.start - row, cols.start - col
        window[top : top + known.shape[0], left : left + known.shape[1]] = known
        return window

    def add(self, footprint: ScanFootprint) -> None:
        """Add the evidence of a drawn scan, clamped."""
        height, width = footprint.evidence.shape
        if height == 0 or width == 0:
            return
        row, col = self._grow_to(footprint.corner, (height, width))
        window = self.log_odds[row : row + height, col : col + width]
        is_quiet = self.is_quiet[row : row + height, col : col + width]
        before, was_quiet = window.copy(), is_quiet.copy()
        is_quiet |= footprint.is_quiet
        step = steps_of(footprint, self.config) * np.float32(UNIT)
        limit = np.float32(limit_units(self.config) * UNIT)
        np.clip(window + step, -limit, limit, out=window)
        self._known_cells += int(unknown(before).sum()) - int(unknown(window).sum())
        changed = is_quiet != was_quiet
        for told in (OCCUPIED_LOG_ODDS, -KNOWN_LOG_ODDS, CROSSED_LOG_ODDS):
            changed |= (before > told) != (window > told)
        rows, cols = (np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0))
        if len(rows):
            first = (footprint.corner[0] + int(rows[0]), footprint.corner[1] + int(cols[0]))
            self._forget(first, (int(np.ptp(rows)) + 1, int(np.ptp(cols)) + 1))

    def make_room(self, corner: tuple[int, int], end: tuple[int, int]) -> None:
        """Grow to hold the lattice cells from `corner` to before `end`."""
        if end > corner:
            self._grow_to(corner, (end[0] - corner[0], end[1] - corner[1]))

    def take_over(self, other: OccupancyGrid) -> None:
        """Copy what both grids have room for; the rest stays."""
        self.put(other._corner, other.log_odds, other.is_quiet)

    def put(
        self, corner: tuple[int, int], log_odds: NDArray[np.float32], is_quiet: BoolArray
    ) -> None:
        """Replace the cells of a lattice window; what lies outside the grid is dropped."""
        ours, theirs = [], []
        for i in (0, 1):
            first = max(corner[i], self._corner[i])
            last = min(corner[i] + log_odds.shape[i], self._corner[i] + self.shape[i])
            ours.append(slice(first - self._corner[i], max(last - self._corner[i], 0)))
            theirs.append(slice(first - corner[i], max(last - corner[i], 0)))
        self._known_cells += int(unknown(self.log_odds[tuple(ours)]).sum())
        self.log_odds[tuple(ours)] = log_odds[tuple(theirs)]
        self._known_cells -= int(unknown(self.log_odds[tuple(ours)]).sum())
        self.is_quiet[tuple(ours)] = is_quiet[tuple(theirs)]
        self._forget(corner, log_odds.shape)

    def _forget(self, corner: tuple[int, int], size: tuple[int, ...]) -> None:
        """What was made from the cells of a lattice window is out of date."""
        self._distance_m = self._walls = None
        self.distances.changes.add(corner, (size[0], size[1]))

    def _grow_to(self, corner: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
        """Make room for a lattice window; returns its first cell."""
        low = [min(self._corner[i], corner[i] // BLOCK_CELLS * BLOCK_CELLS) for i in (0, 1)]
        high = [
            max(
                self._corner[i] + self.shape[i],
                -(-(corner[i] + size[i]) // BLOCK_CELLS) * BLOCK_CELLS,
            )
            for i in (0, 1)
        ]
        shape = (high[0] - low[0], high[1] - low[1])
        if shape != self.shape:
            self.distances.open_sides(self, low, high)
            row, col = self._corner[0] - low[0], self._corner[1] - low[1]
            after = (shape[0] - row - self.shape[0], shape[1] - col - self.shape[1])
            margins = ((row, after[0]), (col, after[1]))
            self.log_odds = np.pad(self.log_odds, margins)
            self.is_quiet = np.pad(self.is_quiet, margins)
            self._corner = (low[0], low[1])
        return corner[0] - self._corner[0], corner[1] - self._corner[1]
