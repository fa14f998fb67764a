# SPDX-License-Identifier: MIT
"""Tables and pictures of a benchmark's lines."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]
Reference = dict[tuple[str, int, str], float]
SHORTEST_M = 3.0  # a known-map route shorter than this gives no meaningful ratio


def read_reference(folder: Path) -> Reference:
    """Length of the known-map route to 99 % by (world, start, mode); empty without the file."""
    file = folder / "reference.jsonl"
    found: Reference = {}
    for line in file.read_text().splitlines() if file.exists() else ():
        row = json.loads(line)
        if row["alg"] == "offline99":
            found[row["map"], int(row.get("start", 0)), row["mode"]] = float(row["L99"])
    return found


def ratio_of(row: Row, reference: Reference) -> float | None:
    """Path to 99 % (to the end, where 99 % was missed) over the known-map route."""
    route_m = reference.get((row["world"], row["start"], row["mode"]), 0.0)
    if route_m < SHORTEST_M:
        return None
    return float(row["l99_m"] or row["path_m"]) / route_m


def groups_of(rows: Iterable[Row]) -> dict[tuple[str, str, str], list[Row]]:
    """Lines by (mode, pose, strategy)."""
    groups: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row["mode"], row["pose"], row["strategy"]].append(row)
    return dict(groups)


def table(rows: list[Row], reference: Reference) -> str:
    """One line per mode, pose and strategy."""
    lines = [
        "| mode | pose | strategy | runs | missed 99 % | other failures | ratio mean | sd "
        "| median | worst | L90 m | L95 m | L99 m | coverage | stops | time s | ms/decision |",
        "|" + "---|" * 17,
    ]
    for (mode, pose, strategy), mine in groups_of(rows).items():
        ratios = [r for row in mine if (r := ratio_of(row, reference)) is not None]
        missed = sum(row["l99_m"] is None for row in mine)
        failed = sum(row["failure"] is not None for row in mine) - missed
        figures = [
            *(_figure(ratios, f, 2) for f in (np.mean, np.std, np.median, np.max)),
            *(_figure(_reached(mine, f"l{mark}_m"), np.mean, 1) for mark in (90, 95, 99)),
            _figure([row["coverage"] for row in mine], np.mean, 4),
            _figure([row["stops99"] or row["stops"] for row in mine], np.mean, 1),
            _figure([row["time99_s"] or row["time_s"] for row in mine], np.mean, 0),
            _figure(_reached(mine, "ms_per_decision"), np.median, 1),
        ]
        lines.append(
            f"| {mode} | {pose} | {strategy} | {len(mine)} | {missed} | {max(failed, 0)} | "
            + " | ".join(figures)
            + " |"
        )
    return "\n".join(lines)


def world_table(rows: list[Row], reference: Reference) -> str:
    """L99 by world, and in brackets its ratio, mean over starts and seeds."""
    groups = groups_of(rows)
    names = [" ".join(key) for key in groups]
    lines = ["| world | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for world in sorted({row["world"] for row in rows}):
        cells = []
        for mine in groups.values():
            here = [row for row in mine if row["world"] == world]
            lengths = _figure(_reached(here, "l99_m"), np.mean, 1)
            ratios = [r for row in here if (r := ratio_of(row, reference)) is not None]
            missed = sum(row["l99_m"] is None for row in here)
            cells.append(
                f"{lengths} ({_figure(ratios, np.mean, 2)})"
                + (f" missed {missed}" if missed else "")
            )
        lines.append(f"| {world} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _reached(rows: list[Row], name: str) -> list[float]:
    return [v for row in rows if (v := row[name]) is not None and math.isfinite(v)]


def _figure(values: list[float], summary: Any, digits: int) -> str:
    return f"{float(summary(values)):.{digits}f}" if values else "-"


def plot(rows: list[Row], folder: Path) -> list[Path]:
    """Mean coverage against distance and against time, one picture per mode and pose."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    files = []
    by_panel: dict[tuple[str, str], dict[str, list[Row]]] = defaultdict(dict)
    for (mode, pose, strategy), mine in groups_of(rows).items():
        by_panel[mode, pose][strategy] = mine
    for (mode, pose), strategies in by_panel.items():
        figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True)
        for column, (ax, label) in enumerate(
            zip(axes, ("distance driven, m", "time, s"), strict=True)
        ):
            for strategy, mine in strategies.items():
                grid, mean = mean_curve(mine, column)
                ax.plot(grid, 100.0 * mean, label=strategy)
            ax.set_xlabel(label)
            ax.set_ylim(0, 101)
            ax.grid(alpha=0.3)
        axes[0].set_ylabel("seen, % of what can be seen")
        axes[1].legend(loc="lower right")
        figure.suptitle(f"{mode}, {pose} pose: mean of {len(mine)} runs")
        figure.tight_layout()
        files.append(folder / f"coverage_{mode}_{pose}.png")
        figure.savefig(files[-1], dpi=110)
        plt.close(figure)
    return files


def mean_curve(rows: list[Row], column: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean share seen over a common axis: column 0 distance, 1 time; a run keeps its last."""
    curves = [np.array(row["curve"]).reshape(-1, 3) for row in rows if row["curve"]]
    longest = max((float(c[-1, column]) for c in curves), default=1.0)
    grid = np.linspace(0.0, longest, 200)
    shares = [
        c[np.maximum(np.searchsorted(c[:, column], grid, side="right") - 1, 0), 2]
        for c in curves
    ]
    return grid, np.mean(shares, axis=0) if shares else np.zeros(len(grid))
