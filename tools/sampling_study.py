# SPDX-License-Identifier: MIT
"""What sampling "through multiple realizations" buys: 1, 5 and 10 revolutions a scan.

    python tools/sampling_study.py                            # standing in the simulator
    python tools/sampling_study.py --data ../shared/data      # and on a standing Botvac's turns
    python tools/sampling_study.py --runs rooms office --out runs/sampling   # and whole runs

Standing, the error of combined scans is against the true range; on real turns against the
median of the turns that were not combined, which hides what is constant. `wrong` readings are
off by more than 0.1 m plus 4 standard deviations of a single one. One table each on stdout.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
from sensor_study import recordings, simulated
from sensor_study.standstill import Standstill

from ins_robot.config import Config, LrfConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.messages import LaserScan
from ins_robot.sensing.range_error import range_std_m
from ins_robot.sensing.scan_filter import combine
from ins_robot.simulation.shipped_worlds import DIRECTORY, shipped_worlds

COUNTS = (1, 5, 10)
TURNS = simulated.TURNS
PLACES, SEED = 12, 0
BINS_M = ((0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.5))
WRONG_M, WRONG_STDS = 0.1, 4.0
RUN_KEYS = ("coverage", "localization_rmse_m", "wall_error_m", "collisions", "scans")
LRF = LrfConfig()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="directory of the recordings")
    parser.add_argument("--runs", nargs="*", default=[], help="worlds of whole runs")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/sampling"))
    args = parser.parse_args()
    worlds = sorted(DIRECTORY.glob("*.yaml"))
    everywhere = np.ones(360, dtype=bool)
    stands = simulated.stand_in_homes(worlds, Config().simulation, everywhere, PLACES, SEED)
    names = ", ".join(shipped_worlds())
    print(f"simulated, standing at {PLACES} places each of {names}:\n")
    print(table([(turns.standstill, turns.true_m) for turns in stands]))
    if args.data is not None:
        print("\nreal, a standing Botvac:\n")
        print(table(held_out(args.data)))
    if args.runs:
        print("\nwhole runs:\n")
        print(runs_table(args.runs, args.seeds, args.out))
    return 0


def held_out(data: Path) -> list[tuple[Standstill, FloatArray]]:
    """Standstills long enough: the last turns as the truth, the others to combine."""
    botvac = [
        recordings.read_recording(data / "robot" / f"{name}.csv") for name in recordings.BOTVAC
    ]
    is_open = recordings.open_beams(botvac)
    found = []
    for recording in botvac:
        for still in recording.standstills(is_open):
            used = max(COUNTS) * ((len(still.ranges_m) // 2) // max(COUNTS))
            if not used:
                if len(still.ranges_m) < max(COUNTS) + 5:
                    continue
                used = max(COUNTS)
            ranges_m = np.where(is_open, still.ranges_m, np.nan)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                truth_m = np.nanmedian(ranges_m[used:], axis=0)
            found.append((Standstill(still.name, ranges_m[:used], is_open), truth_m))
    return found


def table(stands: list[tuple[Standstill, FloatArray]]) -> str:
    """Error of readings that are not wrong, shares of valid and wrong ones, and their cost."""
    bins = " | ".join(f"rms mm, {low:g} to {high:g} m" for low, high in BINS_M)
    lines = [f"| revolutions | {bins} | valid | wrong of valid | told / true | turning s |"]
    lines.append("|---" * (len(BINS_M) + 5) + "|")
    for count in COUNTS:
        errors_m, walls_m, stds_m, valid = [], [], [], []
        for still, truth_m in stands:
            for first in range(0, len(still.ranges_m) - count + 1, count):
                scan = combine(turns_as_scans(still.ranges_m[first : first + count]), LRF)
                known = np.isfinite(truth_m) & (truth_m < LRF.range_max_m)
                errors_m.append((scan.ranges_m - truth_m)[known])
                walls_m.append(truth_m[known])
                stds_m.append(scan.range_std_m[known])
                valid.append(scan.is_valid[known])
        error, wall, std = (np.concatenate(a) for a in (errors_m, walls_m, stds_m))
        single = range_std_m(wall, LRF.range_std_floor_m, LRF.range_std_per_m3)
        has = np.isfinite(error)
        wrong = np.abs(error[has]) > WRONG_M + WRONG_STDS * single[has]
        right = error[has][~wrong]
        right_wall, right_std = wall[has][~wrong], std[has][~wrong]
        cells = [
            f"{1e3 * rms(right[(right_wall >= low) & (right_wall < high)]):.1f}"
            for low, high in BINS_M
        ]
        ratio = rms(right_std) / rms(right)
        lines.append(
            f"| {count} | {' | '.join(cells)} | {np.concatenate(valid).mean():.3f} "
            f"| {wrong.mean():.4f} | {ratio:.2f} | {60.0 * count / LRF.rpm:.1f} |"
        )
    return "\n".join(lines)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def turns_as_scans(ranges_m: FloatArray) -> list[LaserScan]:
    """Turns (T, 360) as the driver would give them: gated, with the sensor model's error."""
    gated = np.where((ranges_m >= LRF.range_min_m) & (ranges_m <= LRF.range_max_m), 1.0, np.nan)
    return [
        LaserScan(
            stamp_s=0.0,
            bearings_rad=simulated.TURN_RAD,
            ranges_m=row,
            range_std_m=range_std_m(row, LRF.range_std_floor_m, LRF.range_std_per_m3),
            beam_offsets_s=np.zeros(len(row)),
            range_max_m=LRF.range_max_m,
            rpm=LRF.rpm,
        )
        for row in ranges_m * gated
    ]


def runs_table(worlds: list[str], seeds: int, out: Path) -> str:
    keys = (*RUN_KEYS, "duration_s", "lrf_on_s")
    lines = ["| run | revolutions | " + " | ".join(keys) + " |", "|---" * (len(keys) + 2) + "|"]
    for world in worlds:
        for seed in range(seeds):
            for count in COUNTS:
                summary = run(world, seed, count, out / f"{Path(world).stem}-{seed}-{count}")
                cells = " | ".join(f"{summary[key]:g}" for key in keys)
                lines.append(f"| {Path(world).stem}-{seed} | {count} | {cells} |")
    return "\n".join(lines)


def run(world: str, seed: int, count: int, out: Path) -> dict[str, float]:
    command = [sys.executable, "-m", "ins_robot", "simulate", world, "--seed", str(seed)]
    command += ["--out", str(out), "--json", "--set", f"lrf.revolutions={count}"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if not done.stdout:
        raise SystemExit(f"{world}, seed {seed}: {done.stderr.strip()[-500:]}")
    found: dict[str, float] = json.loads(done.stdout)
    return found


if __name__ == "__main__":
    raise SystemExit(main())
