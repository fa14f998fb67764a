# SPDX-License-Identifier: MIT
"""One log, one estimator, one seed, in a process of its own: its figures, its files.

Times are processor time of this process, so that others at work here count little; beside them
stands a fixed numpy kernel, timed every few scans in between, for other machines to compare.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ins_robot.logs.replay import replay_log
from ins_robot.logs.run_directory import prepare_directory, write_run
from slam_study.ablations import configured
from slam_study.cases import Case
from slam_study.trajectory import Trajectory

KERNEL_EVERY = 20  # scans
TENTH = 10


@dataclass(frozen=True)
class Job:
    case: Case
    estimator: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.case.name}-{self.estimator}-{self.seed}"


@dataclass
class Kernel:
    """What a scan matcher does most: look-ups in a table, an exponential, a small product."""

    table: np.ndarray = field(default_factory=lambda: np.linspace(0.0, 1.0, 100_000))
    index: np.ndarray = field(
        default_factory=lambda: (np.arange(100_000) * 7919) % 100_000  # a prime: no order
    )
    times_ms: list[float] = field(default_factory=list)
    calls: int = 0

    def after_scan(self, share: float) -> None:
        self.calls += 1
        if self.calls % KERNEL_EVERY == 1:
            begun_s = time.process_time()
            values = np.exp(-self.table.take(self.index)).reshape(-1, 100)
            values.T @ values
            self.times_ms.append(1e3 * (time.process_time() - begun_s))


def run(job: Job, data: Path, out: Path) -> dict[str, Any]:
    """Replay, write the run's files to out/NAME, score."""
    log = job.case.read(data)
    config = configured(job.estimator, job.seed)
    rng = np.random.default_rng(job.seed)
    kernel = Kernel()
    clock: Callable[[], float] = time.process_time
    result = replay_log(log, config, job.name, rng, clock, kernel.after_scan)
    directory = out / job.name
    prepare_directory(directory)
    summary = write_run(directory, result)
    trajectory = Trajectory.of(result.stamps_s, result.map_from_base, job.case.ahead_m)
    times_ms = np.array(result.slam_ms)
    tenth = max(1, len(times_ms) // TENTH)
    return {
        "run": job.name,
        "case": job.case.name,
        "estimator": job.estimator,
        "seed": job.seed,
        **job.case.score(trajectory, log, data),
        "ms_median": float(np.median(times_ms)),
        "ms_p95": float(np.percentile(times_ms, 95.0)),
        "kernel_ms": float(np.median(kernel.times_ms)),
        "growth": float(times_ms[-tenth:].mean() / times_ms[:tenth].mean()),
        "rss_mb": summary["peak_rss_mb"],
        "nodes": summary["nodes"],
        "loop_closures": summary["loop_closures"],
    }
