# SPDX-License-Identifier: MIT
"""Pictures of the comparison: every quantity's distributions, and the error characteristic.

matplotlib comes with filterpy; it is imported here only, in tools.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from sensor_study.distance import Verdict
from sensor_study.range_fit import RangeLaw
from sensor_study.standstill import Standstill

REAL, SIMULATED = "tab:blue", "tab:orange"
COLUMNS = 4


def draw_distributions(verdicts: Sequence[Verdict], path: Path) -> None:
    """Distribution functions: real parts thin, simulator thick."""
    rows = -(-len(verdicts) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(4.2 * COLUMNS, 3.1 * rows))
    for ax, verdict in zip(axes.flat, verdicts, strict=False):
        _distribution(ax, verdict)
    for ax in list(axes.flat)[len(verdicts) :]:
        ax.axis("off")
    axes.flat[0].legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    plt.close(figure)


def _distribution(ax: Axes, verdict: Verdict) -> None:
    quantity = verdict.quantity
    everything = np.concatenate([*quantity.real, *quantity.simulated])
    low, high = np.percentile(everything, [0.5, 99.5])
    margin = 0.05 * (high - low) or 1.0
    for i, part in enumerate(quantity.real):
        label = "real, by part" if i == 0 else None
        ax.plot(np.sort(part), _shares(part), color=REAL, lw=0.8, label=label)
    simulated = np.concatenate(quantity.simulated)
    ax.plot(np.sort(simulated), _shares(simulated), color=SIMULATED, lw=2.0, label="simulated")
    ax.set_xlim(low - margin, high + margin)
    ax.set_ylim(0.0, 1.02)
    ax.set_title(quantity.name, fontsize=9)
    word = "within" if verdict.is_within else "beyond"
    ax.set_xlabel(
        f"{quantity.unit};  KS {verdict.ks:.2f} ({verdict.allowed_ks:.2f}): {word}", fontsize=8
    )


def _shares(values: np.ndarray) -> np.ndarray:
    return np.arange(1, len(values) + 1) / len(values)


def draw_error_characteristic(
    real: Sequence[Standstill],
    simulated: Sequence[Standstill],
    laws: dict[str, RangeLaw],
    path: Path,
) -> None:
    """Standard deviation of steady beams over range (the paper's figure 3), real and ours."""
    figure, axes = plt.subplots(1, 2, figsize=(12.0, 5.0), sharex=True, sharey=True)
    grid_m = np.geomspace(0.4, 6.0, 100)
    for ax, stills, colour, title in (
        (axes[0], real, REAL, "real: Botvac, four standstills"),
        (axes[1], simulated, SIMULATED, "simulated: standing in four homes"),
    ):
        ranges_m = np.concatenate([s.steady_ranges_m for s in stills])
        stds_m = np.concatenate([s.steady_stds_m for s in stills])
        ax.loglog(ranges_m, 1e3 * stds_m, ".", ms=3, alpha=0.35, color=colour)
        for (name, law), style in zip(laws.items(), ("k-", "k--", "k:"), strict=False):
            ax.loglog(grid_m, 1e3 * law.std_m(grid_m), style, lw=1.4, label=name)
        ax.set_title(title)
        ax.set_xlabel("range, m")
        ax.set_xlim(0.4, 6.5)
        ax.set_ylim(0.1, 500.0)
        ax.set_xticks([0.5, 1.0, 2.0, 3.0, 4.0, 6.0], ["0.5", "1", "2", "3", "4", "6"])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("standard deviation of one reading, mm")
    axes[0].legend(loc="upper left", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)
