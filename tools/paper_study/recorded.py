# SPDX-License-Identifier: MIT
"""Recorded runs, and what the robot knew in them scan by scan.

`record` lets the whole daemon explore a simulated world, as `ins-robot simulate` does; the
replay of its journal is the same run again, or what another pose estimator makes of the very
same readings.
"""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_system import Job, run

from ins_robot import config as configuration
from ins_robot.core.run_core import RunCore
from ins_robot.geometry.angles import FloatArray
from ins_robot.logs.journal import read_journal
from ins_robot.logs.replay_journal import JournalOptions, JournalReplay
from ins_robot.logs.run_directory import SUMMARY, TRUTH, read_tum
from ins_robot.mapping.map_files import TernaryMap
from ins_robot.messages import LaserScan, Mark
from ins_robot.navigation.explorer import Drive, Finished


@dataclass(frozen=True)
class Recorded:
    """One run: its world, seed, what was set, and where its files are."""

    world: str
    seed: int
    overrides: tuple[str, ...]
    directory: Path

    @property
    def command(self) -> str:
        """What makes it."""
        sets = "".join(f" --set {override}" for override in self.overrides)
        return f"ins-robot simulate {self.world} --seed {self.seed}{sets}"

    def summary(self) -> dict[str, Any]:
        """Its summary.json."""
        found: dict[str, Any] = json.loads((self.directory / SUMMARY).read_text())
        return found

    def truth(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (N,) and true poses (N, 3) in the map frame."""
        return read_tum(self.directory / TRUTH)


def record(out: Path, world: str, seed: int = 0, overrides: Sequence[str] = ()) -> Recorded:
    """A finished run in `out`/runs; one that is there already is taken."""
    name = "-".join([world, str(seed), *(o.partition(".")[2] for o in overrides)])
    recorded = Recorded(world, seed, tuple(overrides), out / "runs" / name)
    if not (recorded.directory / SUMMARY).exists():
        print(recorded.command, file=sys.stderr)
        arguments = Namespace(out=out / "runs", overrides=list(overrides))
        summary = run(Job(name, world, None, seed), arguments)
        if summary["state"] != "complete":
            raise SystemExit(f"{recorded.command}: {summary['state']}: {summary['reason']}")
    return recorded


@dataclass(frozen=True)
class Step:
    """What was known after a scan at a node, and what was decided."""

    map: TernaryMap
    nodes: Sequence[Mapping[str, Any]]
    way_m: FloatArray
    decision: Drive | Finished | None


def replayed(recorded: Recorded, overrides: Sequence[str] = ()) -> Iterator[JournalReplay]:
    """The replay after each scan at a node; it is one object, complete after the last."""
    header, messages = read_journal(recorded.directory / "run.journal")
    config = configuration.loads(header.config_toml, "recorded configuration")
    config = configuration.with_overrides(config, overrides)
    replay = JournalReplay(config, JournalOptions(), lambda: 0.0)
    for message in messages:
        replay.feed(message)
        if isinstance(message, Mark) and message.kind == "node_scan":
            yield replay


def first_revolutions(recorded: Recorded) -> list[LaserScan]:
    """What the first scan is made of, the turn all around."""
    revolutions = []
    for message in read_journal(recorded.directory / "run.journal")[1]:
        if isinstance(message, LaserScan):
            revolutions.append(message)
        if isinstance(message, Mark) and message.kind == "node_scan":
            break
    return revolutions


def finished(recorded: Recorded, overrides: Sequence[str] = ()) -> RunCore:
    """The core at the end of the run."""
    *_, replay = replayed(recorded, overrides)
    return replay.core


def steps(recorded: Recorded) -> list[Step]:
    """One step for each scan at a node."""
    return [
        Step(
            TernaryMap.of(replay.core.survey.grid),
            replay.core.survey.explorer.as_json()["nodes"],
            replay.core.corrected_trajectory()[1][:, :2],
            replay.decision,
        )
        for replay in replayed(recorded)
    ]


def true_poses_at(recorded: Recorded, stamps_s: FloatArray) -> FloatArray:
    """(N, 3) true poses at stamps of the run."""
    truth_s, poses = recorded.truth()
    headings = np.interp(stamps_s, truth_s, np.unwrap(poses[:, 2]))
    xy = [np.interp(stamps_s, truth_s, poses[:, axis]) for axis in (0, 1)]
    return np.stack([*xy, headings], axis=-1)
