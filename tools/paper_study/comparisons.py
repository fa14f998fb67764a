# SPDX-License-Identifier: MIT
"""Figure 6, narrowest against widest gap first, and the questions the paper leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from paper_study import drawing
from paper_study.campaign import STRATEGIES, WORLDS, Campaign, Paired

FIGURE_6 = (
    ("duration_s", "robot time, s", 1.0),
    ("ins_processor_ms", "INS computing time, s", 1e-3),
)
ASKED = {"360 deg": "sector", "continuous": "LRF power"}
FIGURES = {
    "lrf_on_s": "LRF on, s",
    "duration_s": "robot time, s",
    "path_length_m": "way, m",
    "scans": "scans",
    "coverage": "coverage",
    "localization_rmse_m": "localization, m",
    "wall_error_m": "wall error, m",
}
ALL = "all five"


def figure_6(out: Path, seeds: int, jobs: int) -> str:
    """Robot time and INS computing time of both strategies, each world, every seed a dot."""
    campaign = Campaign(out)
    campaign.run(STRATEGIES, seeds, jobs)
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 3.6))
    for ax, (key, label, scale) in zip(axes, FIGURE_6, strict=True):
        _draw_strategies(ax, campaign, key, scale, seeds)
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0.0)
    axes[0].legend(fontsize=8, loc="upper left")
    figure.tight_layout(pad=0.6)
    drawing.save(figure, out / "figure6.png")
    keys = {key: label for key, label, _ in FIGURE_6} | {
        "path_length_m": "way, m",
        "scans": "scans",
        "coverage": "coverage",
    }
    keys["ins_processor_ms"] = "INS computing time, ms"
    return f"{seeds} seeds\n\n{table(campaign, STRATEGIES[0], STRATEGIES[1], keys, seeds)}"


def _draw_strategies(ax: Axes, campaign: Campaign, key: str, scale: float, seeds: int) -> None:
    for offset, variant, colour in ((-0.17, *_LOOKS[0]), (0.17, *_LOOKS[1])):
        for k, world in enumerate(WORLDS):
            values = scale * campaign.column(variant, world, key, seeds)
            spread = np.linspace(-0.08, 0.08, len(values))
            name = variant if k == 0 else None
            ax.bar(k + offset, np.nanmean(values), 0.3, color=colour, alpha=0.35, label=name)
            ax.plot(k + offset + spread, values, ".", ms=4, color=colour)
    ax.set_xticks(
        range(len(WORLDS)), [world.replace("_", "\n") for world in WORLDS], fontsize=8
    )


_LOOKS = tuple(zip(STRATEGIES, (drawing.WAY, drawing.OPEN_GAP), strict=True))


def questions(out: Path, seeds: int, jobs: int) -> str:
    """+-150 against 360 degrees, on demand against continuous: all figures, both in pairs."""
    campaign = Campaign(out)
    base = STRATEGIES[0]
    campaign.run((base, *ASKED), seeds, jobs)
    parts = []
    for variant in ASKED:
        parts.append(f"{variant} against the default, {seeds} seeds:\n")
        parts.append(table(campaign, base, variant, FIGURES, seeds) + "\n")
    return "\n".join(parts)


def table(
    campaign: Campaign, base: str, other: str, figures: dict[str, str], seeds: int
) -> str:
    """Each cell: base, other (difference, its 95 % interval over the pairs)."""
    lines = ["| world | " + " | ".join(figures.values()) + " |"]
    lines.append("|---" * (len(figures) + 1) + "|")
    for name, worlds in (*((world, (world,)) for world in WORLDS), (ALL, WORLDS)):
        cells = [_cell(campaign, base, other, key, worlds, seeds) for key in figures]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    for variant in (base, other):
        states = campaign.states(variant, seeds)
        ended = {state: states.count(state) for state in sorted(set(states))}
        lines.append("")
        lines.append(f"{variant}: " + ", ".join(f"{n} {state}" for state, n in ended.items()))
    return "\n".join(lines)


def _cell(
    campaign: Campaign, base: str, other: str, key: str, worlds: Sequence[str], seeds: int
) -> str:
    ours, theirs = (
        np.concatenate([campaign.column(variant, world, key, seeds) for world in worlds])
        for variant in (base, other)
    )
    pair = Paired.of(ours, theirs)
    digits = 3 if max(pair.base, pair.mean) < 2.0 else 0 if pair.base >= 20.0 else 1
    f = f".{digits}f"
    return (
        f"{pair.base:{f}}, {pair.mean:{f}} "
        f"({pair.difference:+{f}}; {pair.low:+{f}} to {pair.high:+{f}})"
    )
