# SPDX-License-Identifier: MIT
"""What the range finder's readings show, in recordings and in the simulator, side by side.

Two quantities need a wall where a beam was lost: there the real side takes the map which SLAM
makes of the recording, the simulated one the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.config import Config, SimulationConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.logs.botvac import BASE_FROM_LRF, read_botvac
from ins_robot.logs.replay import replay_log
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.sensing.range_error import range_std_m
from sensor_study import recordings, simulated
from sensor_study.motion_samples import gyro, wheels
from sensor_study.quantity import Quantity
from sensor_study.range_fit import STD_MIN_M
from sensor_study.recordings import Botvac, Capture
from sensor_study.standstill import Standstill, lost_run_lengths

HOMES = ("home_movecare_map", "home_uma_236_237", "house_2266672d", "house_3aaac3ad")
PLACES, SEEDS = 5, (0, 1)
NEAR_M, FAR_M = (0.8, 1.6), (2.0, 3.0)
REPEAT_M, BOX_M = (0.5, 1.0), (0.25, 0.6)
EVERY_SCAN = 4
NEIGHBOURS = 4


@dataclass(frozen=True)
class Recorded:
    """All recordings, read once."""

    botvac: list[Botvac]
    is_open: np.ndarray
    standstills: list[Standstill]
    capture: Capture
    expected_m: list[FloatArray]
    """How far the wall of each beam of every `EVERY_SCAN`th scan is, (S, 360), by recording."""
    directory: Path


def read_all(directory: Path) -> Recorded:
    paths = [directory / "robot" / f"{name}.csv" for name in recordings.BOTVAC]
    botvac = [recordings.read_recording(path) for path in paths]
    is_open = recordings.open_beams(botvac)
    capture = recordings.decode_capture((directory / "xv11" / "hand_in_box.bin").read_bytes())
    return Recorded(
        botvac,
        is_open,
        [still for recording in botvac for still in recording.standstills(is_open)],
        capture,
        [expected_ranges_m(path) for path in paths],
        directory,
    )


def expected_ranges_m(path: Path) -> FloatArray:
    """(S, 360) range to the first wall of the map that SLAM makes; inf where it has none."""
    log = read_botvac(path)
    rng = np.random.default_rng(0)
    every_other = log.with_every(2)  # enough for a map
    found = replay_log(every_other, Config(), path.stem, rng, lambda: 0.0, lambda share: None)
    grid = found.grid
    rows = [i for i, record in enumerate(log.records) if record.scan is not None]
    expected = []
    for row in rows[::EVERY_SCAN]:
        scan = log.records[row].scan
        assert scan is not None
        x, y, heading = found.map_from_base[row]
        lrf = np.array([x, y]) + BASE_FROM_LRF.x_m * np.array(
            [np.cos(heading), np.sin(heading)]
        )
        cell = ((lrf - np.asarray(grid.origin_m)) / grid.resolution_m)[::-1]
        starts = np.tile(cell, (len(scan.bearings_rad), 1))
        reach = recordings.RANGE_MAX_M / grid.resolution_m
        cells = cast_rays(grid.is_occupied, starts, scan.bearings_rad + heading, reach)
        expected.append(cells * grid.resolution_m)
    return np.array(expected)


def all_quantities(real: Recorded, simulation: SimulationConfig) -> list[Quantity]:
    homes = [standing_turns(real, simulation, seed) for seed in SEEDS]
    boxes = [simulated.spin_in_box(simulation, seed) for seed in SEEDS]
    return [
        *in_rooms(real, homes, simulation),
        *in_the_box(real.capture, boxes),
        *gyro(real.botvac, simulation),
        *wheels(real.botvac, real.directory / "robot" / "lego", simulation),
    ]


def standing_turns(
    real: Recorded, simulation: SimulationConfig, seed: int
) -> list[simulated.StandingTurns]:
    worlds = [real.directory / "worlds" / f"{name}.yaml" for name in HOMES]
    return simulated.stand_in_homes(worlds, simulation, real.is_open, PLACES, seed)


def simulated_standstills(real: Recorded, simulation: SimulationConfig) -> list[Standstill]:
    return [turns.standstill for turns in standing_turns(real, simulation, SEEDS[0])]


def in_rooms(
    real: Recorded,
    homes: list[list[simulated.StandingTurns]],
    simulation: SimulationConfig,
) -> list[Quantity]:
    stills = [[turns.standstill for turns in home] for home in homes]
    halves = [
        half for r in real.botvac for half in np.array_split(r.ranges_m, 2)
    ]  # while driving, too: whether a beam comes back does not depend on that
    source = "Botvac, 4 standstills"
    driving = "Botvac, 2 halves of 2 drives"
    no_wall = "walls that never answered are missing from the map the range is taken from"
    found = [
        Quantity(
            "range noise over the law",
            "log10 of ratio",
            source,
            "repeats do not show what is constant (calibration, surface)",
            [_over_law(still, simulation) for still in real.standstills],
            [np.concatenate([_over_law(s, simulation) for s in still]) for still in stills],
        ),
        Quantity(
            "equal readings in a row, 0.5 to 1 m",
            "share by beam",
            source,
            "",
            [still.repeated_share(*REPEAT_M) for still in real.standstills],
            [np.concatenate([s.repeated_share(*REPEAT_M) for s in still]) for still in stills],
        ),
        Quantity(
            "turns lost by a beam that mostly sees",
            "share by beam",
            source,
            "",
            [still.lost_share_of_seen() for still in real.standstills],
            [np.concatenate([s.lost_share_of_seen() for s in still]) for still in stills],
        ),
        Quantity(
            "drop-outs, length",
            "beams",
            driving,
            "other rooms have other surfaces; beams behind the Botvac's own posts left out",
            [lost_run_lengths(half, real.is_open) for half in halves],
            [
                np.concatenate([lost_run_lengths(s.ranges_m[:1], real.is_open) for s in still])
                for still in stills
            ],
        ),
    ]
    for low_m, high_m in (NEAR_M, FAR_M):
        found.append(
            Quantity(
                f"valid share, walls at {low_m:g} to {high_m:g} m",
                "share by scan",
                driving,
                no_wall,
                [
                    part
                    for r, expected in zip(real.botvac, real.expected_m, strict=True)
                    for part in np.array_split(
                        _valid_shares(
                            r.ranges_m[::EVERY_SCAN], expected, real.is_open, low_m, high_m
                        ),
                        2,
                    )
                ],
                [
                    np.concatenate(
                        [
                            _valid_shares(
                                turns.standstill.ranges_m[:1],
                                turns.true_m[None],
                                real.is_open,
                                low_m,
                                high_m,
                            )
                            for turns in home
                        ]
                    )
                    for home in homes
                ],
            )
        )
    return found


def _over_law(still: Standstill, simulation: SimulationConfig) -> FloatArray:
    ranges_m, stds_m = still.steady_ranges_m, still.steady_stds_m
    law_m = range_std_m(ranges_m, simulation.range_std_floor_m, simulation.range_std_per_m3)
    is_far = (ranges_m > 0.8) & (ranges_m < 5.0) & np.isfinite(stds_m)
    ratio: FloatArray = np.log10(np.maximum(stds_m[is_far], STD_MIN_M) / law_m[is_far])
    return ratio


def _valid_shares(
    ranges_m: FloatArray, wall_m: FloatArray, is_open: np.ndarray, low_m: float, high_m: float
) -> FloatArray:
    """By scan: share of open beams with a reading, of those with a wall at that distance."""
    inside = (wall_m >= low_m) & (wall_m < high_m) & is_open
    count = inside.sum(axis=1)
    share: FloatArray = (inside & np.isfinite(ranges_m)).sum(axis=1) / np.maximum(count, 1)
    return share[count >= 10]


def in_the_box(real: Capture, boxes: list[Capture]) -> list[Quantity]:
    length = len(real.ranges_m) // NEIGHBOURS
    parts = [real.part(slice(i * length, (i + 1) * length)) for i in range(NEIGHBOURS)]
    source = "XV-11 capture, 4 quarters"
    moving = "one sensor in one box, a hand moving in it"

    def each(
        name: str, unit: str, value: Callable[[Capture], FloatArray], caveat: str = moving
    ) -> Quantity:
        return Quantity(
            name, unit, source, caveat, [value(p) for p in parts], [value(b) for b in boxes]
        )

    everywhere = np.ones(360, dtype=bool)

    def repeated(part: Capture) -> FloatArray:
        return Standstill("box", part.ranges_m, everywhere).repeated_share(*BOX_M)

    return [
        each(
            "valid share in a box", "share by turn", lambda p: np.isfinite(p.ranges_m).mean(1)
        ),
        each("equal readings in a row, box", "share by beam", repeated),
        each("error codes in a box", "code", lambda p: p.error_code[p.error_code > 0].ravel()),
        each(
            "strength x r^2",
            "m^2",
            lambda p: (p.strength * p.ranges_m**2)[
                np.isfinite(p.ranges_m) & (p.ranges_m > 0.35) & ~p.is_weak
            ].ravel(),
            "the reflectivity of the box is not known",
        ),
        each(
            "speed ripple, from the turn's mean",
            "share",
            lambda p: (p.rpm / p.rpm.mean(axis=1, keepdims=True) - 1.0).ravel(),
            "one motor, 24 s",
        ),
        each(
            "speed ripple, turn by turn",
            "share",
            lambda p: p.rpm.mean(axis=1) / p.rpm.mean() - 1.0,
            "one motor, 24 s",
        ),
    ]
