# SPDX-License-Identifier: MIT
"""The core of a run in which a person carries the LRF (the paper's emulation stage).

As `RunCore`, but the motion between two scans is what the person was asked to do, and a scan is
first looked for around there: one that fits nowhere is refused and changes nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ins_robot.config import Config
from ins_robot.core.carried_odometry import CarriedOdometry
from ins_robot.core.run_core import RunCore, ScanJob, ScanOutcome
from ins_robot.core.survey import Timer
from ins_robot.estimation.placement import Misfit
from ins_robot.geometry.pose2 import Pose2


class CarriedCore(RunCore):
    """Put down, scan, be told where next."""

    odometry: CarriedOdometry

    def __init__(self, config: Config, rng: np.random.Generator, timer_s: Timer) -> None:
        exploration = replace(config.exploration, return_home=False)  # nobody needs to be told
        super().__init__(replace(config, exploration=exploration), rng, timer_s)
        self.odometry = CarriedOdometry(config.base)
        self.refused_scans = 0
        self._scanned_at: Pose2 | None = None

    def put_down(self, stamp_s: float, place: Pose2) -> None:
        """A person says that the LRF stands at `place` (map_from_base), more or less."""
        if self.first_stamp_s is None:
            self.first_stamp_s = stamp_s
        self.last_stamp_s = stamp_s
        self.odometry.put_down(stamp_s, self.map_from_odom.inverse() @ place)

    @property
    def notes(self) -> dict[str, Any]:
        """What summary.json tells beside what every run has."""
        return {"refused_scans": self.refused_scans}

    def compute(self, job: ScanJob) -> ScanOutcome:
        """The heavy part; without an estimate in the outcome, the scan fits nowhere."""
        stamp_s = job.scan.stamp_s
        self.last_stamp_s = max(self.last_stamp_s, stamp_s)
        motion = self.survey.place(job.scan, job.motion)
        if isinstance(motion, Misfit):
            self._forget(job)
            return ScanOutcome(job=job, estimate=None, decision=None, misfit=motion)
        outcome = super().compute(replace(job, motion=motion))
        assert outcome.estimate is not None
        self.trajectory.add(stamp_s, job.odom_from_base)
        before, self._scanned_at = self._scanned_at, outcome.estimate.pose
        if before is not None:
            self.path_length_m += before.distance_m(self._scanned_at)
        return outcome

    def _forget(self, job: ScanJob) -> None:
        """The scan was not taken."""
        self.refused_scans += 1
        self.scans -= 1
        del self._odom_at_scans[job.scan.stamp_s]
        before_s = job.motion.from_stamp_s
        self._located_at_s = before_s if self._odom_at_scans else None


def make_core(config: Config, rng: np.random.Generator, timer_s: Timer) -> RunCore:
    """The core that `base.kind` wants."""
    make = CarriedCore if config.base.kind == "manual" else RunCore
    return make(config, rng, timer_s)
