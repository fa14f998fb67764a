# SPDX-License-Identifier: MIT
"""The simulated LRF, gyro and wheels held against recordings of real ones.

    python tools/compare_sensor.py ../shared/data --out runs/sensor
    ... --set simulation.reflectivity_spread=2.2 --set simulation.strength_lost=12

One table on stdout: for each quantity the two-sample distance between simulator and recordings,
and beside it the largest between parts of the recordings, which is what it may be. With --out
also distributions.png and error_characteristic.png. Needs matplotlib (filterpy brings it).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from sensor_study import samples
from sensor_study.distance import Verdict, judge
from sensor_study.range_fit import RangeLaw, fit_range_law
from sensor_study.standstill import Standstill

from ins_robot.config import load

COLUMNS = (
    "| quantity | unit | real 10 / 50 / 90 % | simulated | KS | of real parts | Wasserstein "
    "| of real parts | within |"
)
SPECIFIED = RangeLaw(0.002, 0.00083, 2.0)
"""3 cm at 6 m, growing with the square (Konolige et al. 2008)."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="directory of the recordings")
    parser.add_argument("--out", type=Path, help="where the pictures go")
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    args = parser.parse_args()
    simulation = load(None, args.overrides).simulation
    real = samples.read_all(args.data)
    verdicts = [judge(quantity) for quantity in samples.all_quantities(real, simulation)]
    print(table(verdicts))
    laws = fitted_laws(real.standstills)
    print("\nrange noise of steady beams, fitted (standard errors by bootstrap):")
    for name, law in laws.items():
        print(f"- {name}: {law}")
    for still in real.standstills:
        print(f"- cubic, {still.name} alone: {fitted_laws([still])['cubic']}")
    if args.out is not None:
        from sensor_study.plots import draw_distributions, draw_error_characteristic

        args.out.mkdir(parents=True, exist_ok=True)
        draw_distributions(verdicts, args.out / "distributions.png")
        draw_error_characteristic(
            real.standstills,
            samples.simulated_standstills(real, simulation),
            {
                "cubic, fitted": laws["cubic"],
                "square, fitted": laws["square"],
                "specification": SPECIFIED,
            },
            args.out / "error_characteristic.png",
        )
    return 0


def fitted_laws(stills: list[Standstill]) -> dict[str, RangeLaw]:
    ranges_m = np.concatenate([still.steady_ranges_m for still in stills])
    stds_m = np.concatenate([still.steady_stds_m for still in stills])
    return {
        name: fit_range_law(ranges_m, stds_m, np.random.default_rng(0), exponent)
        for name, exponent in (("cubic", 3.0), ("square", 2.0), ("free exponent", None))
    }


def table(verdicts: list[Verdict]) -> str:
    lines = [COLUMNS, "|---" * COLUMNS.count(" | ") + "|---|"]
    for v in verdicts:
        q = v.quantity
        lines.append(
            f"| {q.name} | {q.unit} | {_tenths(q.real)} | {_tenths(q.simulated)} "
            f"| {v.ks:.2f} | {v.allowed_ks:.2f} | {v.wasserstein:.3g} "
            f"| {v.allowed_wasserstein:.3g} | {'yes' if v.is_within else '**no**'} |"
        )
    lines += ["", "What the recordings cannot tell:"]
    lines += [
        f"- {q.name} ({q.source}): {q.caveat}" for v in verdicts if (q := v.quantity).caveat
    ]
    return "\n".join(lines)


def _tenths(parts: list[np.ndarray]) -> str:
    values = np.percentile(np.concatenate(parts), [10, 50, 90])
    return " / ".join(f"{value:.3g}" for value in values)


if __name__ == "__main__":
    raise SystemExit(main())
