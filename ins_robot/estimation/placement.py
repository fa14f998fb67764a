# SPDX-License-Identifier: MIT
"""Where a scan taken somewhere near a named place fits the map, or that it fits nowhere.

For an LRF that is carried: there is no odometry, only the word of a person, decimetres and tens
of degrees wide. In go the scan, the map and that prior; out comes a prior as narrow as the scan
makes it. Nothing is changed here, so a scan that is refused leaves no trace.

A prior that wide holds many local optima. Each is refined by itself and judged by what it
explains of the known alone: judged by overlap, as in matching, a scan that looks into the
unknown would slide back to where all is known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ins_robot.estimation.scan_matching import Alignment, align, log_likelihoods, search
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import transform_points
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.surfels import Surfels

SEARCH_STDS = 3.0
TURN_STEP_RAD = math.radians(15.0)  # one search covers this much to each side ...
SHIFT_STEP_M = 0.3  # ... and this much, once the heading is known
TURN_KNOWN_RAD = math.radians(4.0)
INLIERS_MIN = 30
IN_THE_OPEN_M = 0.2  # a reading that ends in free space this far from all walls denies the map
BEFORE_END_M = 0.3  # so does one that goes on this far behind a wall
WALL_LOG_ODDS = 0.8
DENIED_COST = 0.9  # log-likelihood, as much as a reading far off its wall
STD_MAX_M = 0.03  # of the weakest direction: beyond, chance decides where along the wall ...
KNOWN_SHARE = 0.8  # ... but hardly where so many readings lie on the map
KNOWN_STD_MAX_M = 0.05
HERE_SHARE = 0.8  # of the readings that the map has a say in: so many lie on it
HERE_INLIERS_MIN = 15
HERE_SURPRISE_MAX = 36.0  # chi-squared of where it fits against where it is expected
RIVAL_M = 0.2  # a candidate this far from the best is another place ...
RIVAL_RAD = math.radians(5.0)
RIVAL_MARGIN = 4.0  # ... and must be less likely by this much


class Demand(NamedTuple):
    """How much of a scan must lie on the map's walls, and how little of it may be denied."""

    inlier_share_min: float
    denied_share_max: float


class Misfit(NamedTuple):
    """Why a scan was laid nowhere, for people: what, its value, the limit."""

    why: str


NAMED_PLACE = Demand(0.3, 0.06)  # somebody says that it is there, more or less
ANY_PLACE = Demand(0.85, 0.03)  # nobody does: false ones had 0.80 and 0.01, or 0.92 and 0.044


def place(
    field: LikelihoodField,
    grid: OccupancyGrid,
    scan: Surfels,
    prior: FloatArray,
    covariance: FloatArray,
    demand: Demand = NAMED_PLACE,
) -> tuple[FloatArray, FloatArray] | Misfit:
    """Pose (3,) and its covariance (3, 3), map frame; or why the scan fits nowhere near.

    Parameters
    ----------
    scan : Surfels
        Base frame.
    prior, covariance : (3,), (3, 3)
        Where it is said to have been taken, and how surely.
    """
    if len(scan) < INLIERS_MIN:
        return too_few(scan)
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    half_width_m = SEARCH_STDS * math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    half_turn_rad = SEARCH_STDS * math.sqrt(float(covariance[2, 2]))
    matches = [
        align(field, scan, start[None], prior, information)
        for start in _starts(field, scan, prior, half_width_m, half_turn_rad)
    ]
    scores = _scores(field, grid, scan, matches, prior, information)
    best = int(np.argmax(scores))
    match = matches[best]
    misfit = _misfit(match, grid, scan, demand) or _rival(matches, scores, best)
    if misfit is not None:
        return misfit
    return match.pose, np.asarray(np.linalg.inv(information + match.information), np.float64)


def too_few(scan: Surfels) -> Misfit:
    """Of a scan of almost nothing."""
    return Misfit(f"{len(scan)} usable readings, {INLIERS_MIN} are needed")


def fits_at(
    field: LikelihoodField,
    grid: OccupancyGrid,
    scan: Surfels,
    prior: FloatArray,
    covariance: FloatArray,
) -> bool:
    """Whether the scan (base frame) may have been taken at a pose (3,) that is known well.

    It need not tell the place: along a corridor it fits wherever the prior has it.
    """
    if len(scan) < HERE_INLIERS_MIN:
        return False
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    match = align(field, scan, prior[None], prior, information)
    off = match.pose - prior
    off[2] = wrap_rad(float(off[2]))
    known_share = match.inlier_share + denied_share(grid, match.pose, scan)
    return (
        match.inliers >= HERE_INLIERS_MIN
        and match.inlier_share >= max(NAMED_PLACE.inlier_share_min, HERE_SHARE * known_share)
        and float(off @ information @ off) < HERE_SURPRISE_MAX
    )


def _starts(
    field: LikelihoodField,
    scan: Surfels,
    prior: FloatArray,
    half_width_m: float,
    half_turn_rad: float,
) -> list[FloatArray]:
    """Poses (3,) to refine: the prior, the best of each heading, the best of each place.

    Narrow windows, since a wide one prunes the right one away.
    """
    starts = [prior]
    turns = max(1, math.ceil(half_turn_rad / TURN_STEP_RAD))
    found = [
        search(
            field, scan, _shifted(prior, 0.0, 0.0, turn), half_width_m, half_turn_rad / turns
        )
        for turn in _centres(half_turn_rad, turns)
    ]
    starts += [result.pose for result in found]
    heading = max(found, key=lambda result: result.value).pose[2] - prior[2]
    shifts = max(1, math.ceil(half_width_m / SHIFT_STEP_M))
    for x in _centres(half_width_m, shifts):
        for y in _centres(half_width_m, shifts):
            centre = _shifted(prior, x, y, heading)
            window_m = half_width_m / shifts
            starts.append(search(field, scan, centre, window_m, TURN_KNOWN_RAD).pose)
    return starts


def _centres(half: float, count: int) -> list[float]:
    """Centres of `count` equal windows that cover +-half."""
    return [(2 * k - count + 1) * half / count for k in range(count)]


def _shifted(pose: FloatArray, x_m: float, y_m: float, turn_rad: float) -> FloatArray:
    shifted: FloatArray = pose + np.array([x_m, y_m, turn_rad])
    return shifted


def _scores(
    field: LikelihoodField,
    grid: OccupancyGrid,
    scan: Surfels,
    matches: list[Alignment],
    prior: FloatArray,
    information: FloatArray,
) -> FloatArray:
    """(C,) log-posterior of the candidates, up to a constant; denied readings count against."""
    poses = np.stack([match.pose for match in matches])
    off = poses - prior
    off[:, 2] = wrap_rad(off[:, 2])
    denied = np.array([denied_share(grid, pose, scan) for pose in poses])
    scores: FloatArray = (
        log_likelihoods(field, scan, poses)
        - 0.5 * np.einsum("ci,ij,cj->c", off, information, off)
        - DENIED_COST * len(scan) * denied
    )
    return scores


def _misfit(
    match: Alignment, grid: OccupancyGrid, scan: Surfels, demand: Demand
) -> Misfit | None:
    """What is missing: readings on the map's walls that hold the scan, few in the open."""
    share, denied = match.inlier_share, denied_share(grid, match.pose, scan)
    if match.inliers < INLIERS_MIN or share < demand.inlier_share_min:
        return Misfit(
            f"at the best place {match.inliers} readings ({share:.0%}) lie on known walls, "
            f"{INLIERS_MIN} and {demand.inlier_share_min:.0%} are needed"
        )
    weakest = float(np.linalg.eigvalsh(match.information[:2, :2])[0])
    std_max_m = KNOWN_STD_MAX_M if share > KNOWN_SHARE else STD_MAX_M
    if weakest < 1.0 / std_max_m**2:
        std_m = 1.0 / math.sqrt(max(weakest, 1.0))
        return Misfit(
            f"along the walls that it sees it may slide by {std_m:.2f} m, {std_max_m:g} at most"
        )
    if denied > demand.denied_share_max:
        return Misfit(
            f"at the best place {denied:.0%} of the readings contradict the map, "
            f"{demand.denied_share_max:.0%} at most"
        )
    return None


def _rival(matches: list[Alignment], scores: FloatArray, best: int) -> Misfit | None:
    """Whether another place is nearly as likely."""
    off = np.stack([match.pose for match in matches]) - matches[best].pose
    off[:, 2] = wrap_rad(off[:, 2])
    away_m = np.hypot(off[:, 0], off[:, 1])
    is_rival = (away_m > RIVAL_M) | (np.abs(off[:, 2]) > RIVAL_RAD)
    is_rival &= scores > scores[best] - RIVAL_MARGIN
    if not is_rival.any():
        return None
    rival = int(np.argmax(np.where(is_rival, scores, -np.inf)))
    return Misfit(
        f"a place {away_m[rival]:.2f} m and {abs(math.degrees(off[rival, 2])):.0f} deg from "
        "the best is nearly as likely"
    )


def denied_share(grid: OccupancyGrid, pose: FloatArray, scan: Surfels) -> float:
    """Share of readings that the map denies: their end in the open, or a wall on their way.

    Parameters
    ----------
    pose : (3,)
        map_from_base; the rays are taken to begin there.
    """
    ends_m = transform_points(pose, scan.points_m)
    cells = grid.cells(ends_m)
    inside = grid.contains(cells)
    rows, cols = cells[inside, 0], cells[inside, 1]
    is_denied = np.zeros(len(ends_m), dtype=bool)
    is_denied[inside] = grid.is_free[rows, cols] & (
        grid.distance_m()[rows, cols] > IN_THE_OPEN_M
    )
    ranges_m = np.hypot(*scan.points_m.T)
    along_m = np.arange(grid.resolution_m, float(ranges_m.max()), grid.resolution_m)  # (S,)
    directions = (ends_m - pose[:2]) / ranges_m[:, None]
    passed_m = pose[:2] + along_m[:, None] * directions[:, None, :]  # (N, S, 2)
    is_wall = grid.log_odds_at(passed_m) > WALL_LOG_ODDS
    is_before_end = along_m < ranges_m[:, None] - BEFORE_END_M
    return float((is_denied | (is_wall & is_before_end).any(axis=1)).mean())
