# SPDX-License-Identifier: MIT
"""What a decision costs while nodes and map grow: one long run through a large office.

    python tools/decision_cost.py --out runs/cost --nodes 500 --side 100 --room 10

The office is SIDE x SIDE metres of rooms with doors; the robot explores it with the configured
sensor and a perfect pose, to NODES or to its own stop. Printed for each tenth of the nodes:
median and worst processor time of `decide`, the box of the map and what of it is known then;
curve.png in OUT. Last lines: the exponent p of the fit time ~ nodes^p, and the peak of memory.
"""

from __future__ import annotations

import argparse
import resource
from pathlib import Path

import matplotlib as mpl
import numpy as np
from exploration_study.measure import configured
from exploration_study.sensor_robot import explore

from ins_robot.config import load
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.strategies import STRATEGY_NAMES
from ins_robot.simulation.world import World

RESOLUTION_M = 0.05
DOOR_M = 1.0
BANDS = 10


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--strategy", default="auto", choices=STRATEGY_NAMES)
    parser.add_argument("--nodes", type=int, default=500)
    parser.add_argument("--side", type=float, default=100.0, help="of the office, metres")
    parser.add_argument("--room", type=float, default=5.0, help="edge of a room, metres")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    world = office(args.side, args.room, np.random.default_rng(args.seed))
    config = configured(load(None, []), args.strategy)
    middle = (0.5 + args.side // (2.0 * args.room)) * args.room
    rows = []
    for run in explore(world, Pose2(middle, middle, 0.0), config):
        height, width = run.grid.shape
        area = height * width * run.grid.resolution_m**2
        rows.append((run.scans, run.decide_ms[-1], area, run.grid.known_m2))
        run.robot.looks.clear()
        if run.scans >= args.nodes:
            break
    args.out.mkdir(parents=True, exist_ok=True)
    report(np.array(rows), args.out / "curve.png")
    return 0


def office(side_m: float, room_m: float, rng: np.random.Generator) -> World:
    """Square rooms, each joined to the next ones by doors somewhere in the wall."""
    count = int(side_m // room_m)
    room, door = round(room_m / RESOLUTION_M), round(DOOR_M / RESOLUTION_M)
    is_occupied = np.zeros((count * room + 1, count * room + 1), bool)
    is_occupied[::room] = is_occupied[:, ::room] = True
    for row in range(count):
        for col in range(1, count):
            for grid in (is_occupied, is_occupied.T):
                first = row * room + int(rng.integers(4, room - door - 4))
                grid[first : first + door, col * room] = False
    return World(is_occupied, RESOLUTION_M, (0.0, 0.0), name="office")


def report(rows: np.ndarray, file: Path) -> None:
    """Table on stdout, curve in a file; rows (N, 4): nodes, ms, m2 of map and m2 known."""
    print("| nodes | map m2 | known m2 | median ms | worst ms |\n|---|---|---|---|---|")
    for band in np.array_split(rows, min(BANDS, len(rows))):
        nodes, _, area, known = band[-1]
        median, worst = np.median(band[:, 1]), band[:, 1].max()
        print(f"| {nodes:.0f} | {area:.0f} | {known:.0f} | {median:.1f} | {worst:.0f} |")
    late = rows[len(rows) // 10 :]
    if len(late) > 2:
        power, _ = np.polyfit(np.log(late[:, 0]), np.log(late[:, 1]), 1)
        print(f"time grows like nodes^{power:.2f}")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"peak RSS {peak_mb:.0f} MB, the simulated world included")
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 3.5))
    axes.plot(rows[:, 0], rows[:, 1], ".", markersize=3)
    axes.set_xlabel("nodes")
    axes.set_ylabel("processor time of a decision, ms")
    axes.set_yscale("log")
    figure.tight_layout()
    figure.savefig(file, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    raise SystemExit(main())
