# SPDX-License-Identifier: MIT
"""Whole simulated runs by variant, world and seed, kept in a file; and what differs in pairs.

A variant is a set of configuration overrides. Runs of one world and seed share their noise, so
two variants are compared run by run. Seeds are the outermost loop: a campaign that is cut short
has whole seeds, and goes on where it stopped.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_system import BUILT_IN, Job, run

from ins_robot.geometry.angles import FloatArray
from ins_robot.logs.replay_journal import JournalOptions, replay_journal

WORLDS = BUILT_IN
VARIANTS: dict[str, tuple[str, ...]] = {
    "min-gap": ("exploration.strategy=min-gap",),
    "max-gap": ("exploration.strategy=max-gap",),
    "360 deg": ("exploration.strategy=min-gap", "lrf.sector_deg=180"),
    "continuous": ("exploration.strategy=min-gap", "lrf.power=continuous"),
}
"""The first makes the paper's choices."""
COMMON = ("exploration.return_home=false",)  # the paper's run ends where the last gap was
STRATEGIES = ("min-gap", "max-gap")
RESAMPLES = 4000

Row = dict[str, Any]


class Campaign:
    """Runs in `out`/campaign.jsonl, one JSON line each."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._file = out / "campaign.jsonl"
        self._rows: dict[tuple[str, str, int], Row] = {}
        if self._file.exists():
            for row in map(json.loads, self._file.read_text().splitlines()):
                self._rows[row["variant"], row["world"], row["seed"]] = row

    def run(self, variants: Sequence[str], seeds: int, jobs: int) -> None:
        """Run what is missing."""
        wanted = [
            (variant, world, seed)
            for seed in range(seeds)
            for world in WORLDS
            for variant in variants
        ]
        missing = [key for key in wanted if key not in self._rows]
        self._out.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(jobs) as pool, self._file.open("a") as file:
            for row in pool.map(lambda key: self._run_one(*key), missing):
                file.write(json.dumps(row) + "\n")
                file.flush()
                self._rows[row["variant"], row["world"], row["seed"]] = row
                print(f"{row['variant']} {row['run']}: {row['state']}", file=sys.stderr)

    def column(self, variant: str, world: str, key: str, seeds: int) -> FloatArray:
        """(S,) one figure of the runs of a world, by seed; NaN where a run has none."""
        rows = [self._rows[variant, world, seed] for seed in range(seeds)]
        return np.array([row.get(key, np.nan) for row in rows], dtype=np.float64)

    def states(self, variant: str, seeds: int) -> list[str]:
        """How the runs of a variant ended."""
        return [self._rows[variant, w, s]["state"] for w in WORLDS for s in range(seeds)]

    def _run_one(self, variant: str, world: str, seed: int) -> Row:
        """One run; its computing time comes from a replay, on this thread's own clock.

        The run's own figure is wall time, which other work on the machine lengthens.
        """
        directory = self._out / "campaign" / variant.replace(" ", "_")
        arguments = Namespace(out=directory, overrides=[*COMMON, *VARIANTS[variant]])
        row = run(Job(f"{world}-{seed}", world, None, seed), arguments)
        journal = directory / f"{world}-{seed}" / "run.journal"
        if variant in STRATEGIES and journal.exists():
            replayed = replay_journal(journal, JournalOptions(), time.thread_time)
            row["ins_processor_ms"] = replayed.ins_ms_total
        shutil.rmtree(journal.parent, ignore_errors=True)
        return {"variant": variant, "world": world, "seed": seed, **row}


@dataclass(frozen=True)
class Paired:
    """Mean of a figure with a variant, and its mean difference from the base's, 95 %."""

    base: float
    mean: float
    difference: float
    low: float
    high: float

    @staticmethod
    def of(base: FloatArray, other: FloatArray) -> Paired:
        """Runs (N,) against runs (N,), pair by pair; a pair without one of the two is out."""
        both = np.isfinite(base) & np.isfinite(other)
        base, other = base[both], other[both]
        differences = other - base
        rng = np.random.default_rng(0)
        picks = rng.integers(len(differences), size=(RESAMPLES, len(differences)))
        low, high = np.percentile(differences[picks].mean(axis=1), [2.5, 97.5])
        return Paired(
            float(base.mean()),
            float(other.mean()),
            float(differences.mean()),
            float(low),
            float(high),
        )
