# SPDX-License-Identifier: MIT
"""The scans of any log with the motion between them, without SLAM: for finding the place.

Recordings of our own go through the core's odometry as in the run; other logs bring their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot import config as configuration
from ins_robot.core.carried_core import CarriedCore, make_core
from ins_robot.core.run_core import RunCore
from ins_robot.errors import InputError
from ins_robot.estimation.motion_model import chain
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import JournalMessages, read_journal
from ins_robot.logs.open_log import LogKind, find_log, read_log
from ins_robot.messages import ImuSample, LaserScan, Mark, MotionIncrement, WheelSample

SPACING_M = 0.3  # scans nearer than this to the last one say the same
SPACING_RAD = math.radians(30.0)

ScanAndMotion = tuple[LaserScan, MotionIncrement]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanSource:
    """Scans, each with the motion since the one before, and where the LRF sits."""

    base_from_lrf: Pose2
    steps: Iterator[ScanAndMotion]


def open_scans(
    path: Path, rng: np.random.Generator, fov_deg: float | None = None
) -> ScanSource:
    """The scans of a log of any kind that `open_log` knows.

    `rng` is for the core that a recording goes through; its odometry draws nothing.

    Raises
    ------
    InputError
        If it cannot be read, or `fov_deg` is given for what tells its own.
    """
    kind, file = find_log(path)
    if kind is LogKind.JOURNAL:
        if fov_deg is not None:
            raise InputError(f"--fov: {file} is {kind.value} and brings its own bearings")
        return _of_journal(file, rng)
    log = read_log(kind, file, fov_deg)
    return ScanSource(
        base_from_lrf=log.base_from_lrf,
        steps=((step.scan, step.motion) for step in log.scan_steps()),
    )


def _of_journal(path: Path, rng: np.random.Generator) -> ScanSource:
    header, messages = read_journal(path)
    config = configuration.loads(header.config_toml, f"{path} (recorded configuration)")
    core = make_core(config, rng, lambda: 0.0)
    return ScanSource(
        base_from_lrf=Pose2(config.lrf.x_m, config.lrf.y_m, 0.0),
        steps=_journal_steps(core, messages),
    )


def _journal_steps(core: RunCore, messages: JournalMessages) -> Iterator[ScanAndMotion]:
    for message in messages:
        match message:
            case ImuSample():
                core.on_imu(message)
            case WheelSample():
                core.on_wheels(message)
            case LaserScan():
                core.on_revolution(message)
            case Mark(kind="scan_begin"):
                core.begin_scan()
            case Mark(kind="put_down") if isinstance(core, CarriedCore):
                core.put_down(message.stamp_s, Pose2(*message.payload["pose"]))
            case Mark(kind="node_scan"):
                job = core.prepare_node_scan(message.payload["set_rpm"])
                yield job.scan, job.motion
            case Mark(kind="sweep"):
                job = core.prepare_sweep()
                yield job.scan, job.motion


def spaced(
    steps: Iterator[ScanAndMotion], spacing_m: float = SPACING_M, turn_rad: float = SPACING_RAD
) -> Iterator[ScanAndMotion]:
    """Only scans that far from the last one given, with the whole motion since then."""
    since: MotionIncrement | None = None
    is_first = True
    for scan, motion in steps:
        since = motion if since is None else chain(since, motion)
        way_m = math.hypot(since.delta.x_m, since.delta.y_m)
        if is_first or way_m >= spacing_m or abs(since.delta.heading_rad) >= turn_rad:
            yield scan, since
            since, is_first = None, False
