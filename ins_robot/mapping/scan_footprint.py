# SPDX-License-Identifier: MIT
"""What one scan says about each cell: a scan at a pose in, hits and misses on the lattice out.

Every beam is sampled along its free way, finer than a cell; its end is a hit. What beams
without a reading free is told by `silence.py`. Weak and far returns weigh less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.silence import Silence
from ins_robot.messages import LaserScan

MISS_WEIGHT_MIN = 0.25  # the way of a noisy beam was free all the same
SAMPLE_SHARE = 0.6  # a beam is looked at this often per cell: only touched corners are skipped


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanFootprint:
    """Evidence of one scan on the map's lattice.

    Attributes
    ----------
    corner : (row, col)
        Lattice cell of `evidence[0, 0]`.
    evidence : (H, W) float32
        Weight in (0, 1] of a hit, minus the weight of a miss, 0 where the scan says nothing.
    is_quiet : (H, W) bool
        Crossed by silent beams that saw neither a wall nor its absence.
    silent_wall_m : (B,) or None
        Before which walls silence was taken to end; None where silence told nothing, or all.
    """

    corner: tuple[int, int]
    evidence: NDArray[np.float32]
    is_quiet: NDArray[np.bool_]
    silent_wall_m: FloatArray | None = None


def draw_scan(
    scan: LaserScan,
    map_from_lrf: Pose2,
    resolution_m: float,
    silence: Silence,
    silent_wall_m: FloatArray | None,
    beam_max_m: float,
) -> ScanFootprint:
    """Rasterise a scan taken at `map_from_lrf`.

    Silence ends before walls at `silent_wall_m` (B,); None when there are none.
    """
    silent_free_m = silence.free_before(silent_wall_m)
    weights = beam_weights(scan, resolution_m)
    order = np.argsort(weights, kind="stable")  # heavier evidence is written later, and stays
    weights = weights[order]
    bearings = scan.bearings_rad[order] + map_from_lrf.heading_rad
    step_col, step_row = np.cos(bearings) / resolution_m, np.sin(bearings) / resolution_m
    start_col, start_row = map_from_lrf.x_m / resolution_m, map_from_lrf.y_m / resolution_m
    free_m = free_ranges_m(scan, resolution_m, silent_free_m, beam_max_m)[order]
    quiet_m = silence.quiet_m[order]
    ranges = scan.ranges_m[order]
    hit = np.nan_to_num(ranges, nan=np.inf) <= beam_max_m
    hit_col = np.floor(start_col + step_col[hit] * ranges[hit]).astype(np.int64)
    hit_row = np.floor(start_row + step_row[hit] * ranges[hit]).astype(np.int64)
    reach = np.maximum(np.maximum(free_m, quiet_m), np.where(hit, ranges, 0.0))
    if not (reach > 0.0).any():
        nothing = np.zeros((0, 0))
        return ScanFootprint(
            corner=(0, 0),
            evidence=nothing.astype(np.float32),
            is_quiet=nothing.astype(bool),
            silent_wall_m=silent_wall_m,
        )
    end_col, end_row = start_col + step_col * reach, start_row + step_row * reach
    col, row = (
        math.floor(min(end_col.min(), start_col)),
        math.floor(min(end_row.min(), start_row)),
    )
    width = math.floor(max(end_col.max(), start_col)) - col + 1
    height = math.floor(max(end_row.max(), start_row)) - row + 1

    def cells_along(ways_m: FloatArray) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        along, beams = _along_ways(ways_m, SAMPLE_SHARE * resolution_m)
        cols = np.take(step_col, beams) * along + (start_col - col)
        rows = np.take(step_row, beams) * along + (start_row - row)
        return rows.astype(np.int32) * np.int32(width) + cols.astype(np.int32), beams

    evidence = np.zeros((height, width), np.float32)
    flat = evidence.reshape(-1)
    cells, beams = cells_along(free_m)
    # numpy keeps the last of several writes to one cell: the heaviest miss, then the hits
    flat[cells] = np.take(-np.maximum(weights, MISS_WEIGHT_MIN).astype(np.float32), beams)
    flat[(hit_row - row) * width + (hit_col - col)] = weights[hit]
    is_quiet = np.zeros((height, width), bool)
    is_quiet.reshape(-1)[cells_along(quiet_m)[0]] = True
    return ScanFootprint(
        corner=(row, col), evidence=evidence, is_quiet=is_quiet, silent_wall_m=silent_wall_m
    )


def beam_weights(scan: LaserScan, resolution_m: float) -> FloatArray:
    """(B,) in (0, 1]: near 1 while the range is surer than half a cell, then falling.

    Silent beams weigh what the median reading weighs.
    """
    noise_cells = scan.range_std_m / (0.5 * resolution_m)
    weights = 1.0 / (1.0 + noise_cells**2)
    silent = ~np.isfinite(weights)
    if silent.all():
        return np.full(len(weights), MISS_WEIGHT_MIN)
    weights[silent] = np.median(weights[~silent])
    return weights


def free_ranges_m(
    scan: LaserScan, resolution_m: float, silent_free_m: FloatArray, beam_max_m: float
) -> FloatArray:
    """(B,) how far each beam's way is drawn as free: up to before its end."""
    valid = scan.is_valid
    noise_m = np.where(valid, np.nan_to_num(scan.range_std_m), 0.0)
    # the last cell before the end, and what noise reaches, stay untouched
    end_m = np.where(valid, scan.ranges_m, silent_free_m) - np.maximum(
        resolution_m, 2.0 * noise_m
    )
    return np.asarray(np.clip(end_m, 0.0, min(scan.range_max_m, beam_max_m)))


def _along_ways(free_m: FloatArray, step_m: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Samples of the free ways: distance from the sensor (N,) and beam (N,), beam by beam."""
    counts = np.ceil(free_m / step_m).astype(np.int64)
    beams = np.repeat(np.arange(len(free_m)), counts)
    starts = np.cumsum(counts) - counts
    along = np.arange(len(beams), dtype=np.float64) - np.take(starts, beams)
    return along * step_m, beams.astype(np.int64)
