# SPDX-License-Identifier: MIT
"""Replay of our own recordings: the journal's messages through the same core, once more.

With the recorded configuration the result is the run's, bit for bit: odometry, SLAM, choices
and every random draw depend on nothing but what the journal holds, in its order. With other
options it is what the run would have been, had the robot gone where it went.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ins_robot import config as configuration
from ins_robot.config import Config
from ins_robot.core.carried_core import CarriedCore, make_core
from ins_robot.core.run_core import ScanJob
from ins_robot.core.run_result import RunResult, RunState
from ins_robot.core.survey import Decision
from ins_robot.errors import InputError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import read_journal
from ins_robot.logs.memory import peak_rss_mb
from ins_robot.mapping.zones import zones_of
from ins_robot.messages import ImuSample, LaserScan, Mark, WheelSample
from ins_robot.navigation.explorer import Drive

# Without odometry a scan may be anywhere a walking robot could have got to.
UNKNOWN_MOTION_STD = (0.5, 0.5, math.radians(20.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalOptions:
    """How to replay."""

    overrides: Sequence[str] = ()
    use_odometry: bool = True
    every: int = 1


class JournalReplay:
    """Feeds one journal to one core."""

    def __init__(self, config: Config, options: JournalOptions, timer_s: Callable[[], float]):
        rng = np.random.default_rng(config.slam.seed)
        self.core = make_core(config, rng, timer_s)
        self.end: Mark | None = None
        self.decision: Decision | None = None  # the last one
        self._options = options
        self._scans_seen = 0

    def feed(self, message: ImuSample | WheelSample | LaserScan | Mark) -> None:
        """One message, in the order of the journal."""
        match message:
            case ImuSample():
                self.core.on_imu(message)
            case WheelSample():
                self.core.on_wheels(message)
            case LaserScan():
                self.core.on_revolution(message)
            case Mark():
                self._on_mark(message)

    def _on_mark(self, mark: Mark) -> None:
        payload = mark.payload
        match mark.kind:
            case "scan_begin":
                self.core.begin_scan()
            case "node_scan" if self._is_wanted():
                self._compute(self.core.prepare_node_scan(payload["set_rpm"]))
            case "put_down" if isinstance(self.core, CarriedCore):
                self.core.put_down(mark.stamp_s, Pose2(*payload["pose"]))
            case "sweep" if self._is_wanted():
                self._compute(self.core.prepare_sweep())
            case "look":
                self._find_itself(self.core.prepare_look(payload["set_rpm"]), payload)
            case "replan":
                self.decision = self.core.replan(Pose2(*payload["pose"]))
            case "give_up" if isinstance(self.decision, Drive):
                pose = Pose2(*payload["pose"])
                self.decision = self.core.give_up(self.decision, payload["why"], pose)
            case "end":
                self.end = mark
            case _:
                self._on_order(mark)

    def _on_order(self, mark: Mark) -> None:
        """What people asked for during the run, and what its budget did."""
        payload = mark.payload
        match mark.kind:
            case "goto":
                with contextlib.suppress(StateError):  # refused then, refused now
                    self.decision = self.core.go_to(
                        (payload["x_m"], payload["y_m"]), Pose2(*payload["pose"])
                    )
            case "go_home":
                self.decision = self.core.go_home(payload["why"], Pose2(*payload["pose"]))
            case "zones":
                self.core.forbid(zones_of(payload["zones"]))

    def _is_wanted(self) -> bool:
        self._scans_seen += 1
        return (self._scans_seen - 1) % self._options.every == 0

    def _find_itself(self, look: ScanJob, payload: dict[str, Any]) -> None:
        look = self._as_far_as_known(look)
        self.core.find_itself(look, payload["paused_s"], is_first=payload["is_first"])

    def _as_far_as_known(self, job: ScanJob) -> ScanJob:
        if self._options.use_odometry:
            return job
        unknown = np.diag(np.square(UNKNOWN_MOTION_STD))
        return replace(job, motion=replace(job.motion, delta=Pose2(), covariance=unknown))

    def _compute(self, job: ScanJob) -> None:
        outcome = self.core.compute(self._as_far_as_known(job))
        if outcome.decision is not None:
            self.decision = outcome.decision


def replay_journal(
    path: Path,
    options: JournalOptions,
    timer_s: Callable[[], float],
    on_progress: Callable[[float], None] = lambda share: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> RunResult:
    """The run of the journal at `path`, computed again, up to where `is_stopped` says so.

    It is asked after a mark when more follows; after True it is not asked again.

    Raises
    ------
    InputError
        If the file is not a journal, or holds no run.
    ConfigError
        If an override is wrong.
    """
    begun_s = timer_s()
    header, messages = read_journal(path)
    recorded = configuration.loads(header.config_toml, f"{path} (recorded configuration)")
    config = configuration.with_overrides(recorded, options.overrides)
    replay = JournalReplay(config, options, timer_s)
    may_stop = is_cut = False
    for message in messages:
        is_cut = may_stop and is_stopped()
        if is_cut:
            break
        replay.feed(message)
        may_stop = isinstance(message, Mark) and replay.core.first_stamp_s is not None
        if isinstance(message, Mark):
            on_progress(messages.progress)
    if replay.core.first_stamp_s is None:
        raise InputError(
            f"{path}: the recording ends before any wheel telemetry or scan: nothing to map"
        )
    replay.core.settle()
    reason = f"interrupted at {messages.progress:.0%}" if is_cut else "the recording ends here"
    end: dict[str, Any] = (
        replay.end.payload
        if replay.end is not None
        else {"state": "stopped", "reason": reason, "lrf_on_s": 0.0}
    )
    notes: dict[str, Any] = {"replay_of": header.run_name}
    if messages.losses:
        notes["recording_losses"] = [str(loss) for loss in messages.losses]
    return replay.core.result(
        name=header.run_name,
        state=RunState(end["state"]),
        reason=end["reason"],
        lrf_on_s=end["lrf_on_s"],
        wall_time_s=timer_s() - begun_s,
        peak_rss_mb=peak_rss_mb(),
        notes=notes,
    )
