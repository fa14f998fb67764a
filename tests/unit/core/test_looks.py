# SPDX-License-Identifier: MIT
"""What a scan tells the core beside the pose: how far since the last look, and the drift."""

from types import SimpleNamespace

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.core.drift_meter import LOOKS_MIN
from ins_robot.core.run_core import RunCore, ScanJob
from ins_robot.daemon.mission import DRIFT, DRIFT_MAX, DRIFT_STDS, Mission
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PoseEstimate

STEP_M = 0.8


class Slam:
    """Says that the robot is `off_m` ahead of where the odometry puts it."""

    def __init__(self):
        self.map_moves, self.is_located, self.moves = 0, True, False
        self.off_m, self.last_m = 0.0, 0.0
        self.was_astray = False

    def scan_on_the_way(self, scan, motion):
        self.map_moves += self.moves
        self.last_m += STEP_M + (self.off_m if self.is_located else 0.0)
        return PoseEstimate(
            stamp_s=0.0, pose=Pose2(self.last_m, 0.0, 0.0), covariance=np.eye(3)
        )


@pytest.fixture
def core():
    core, slam = RunCore(Config(), np.random.default_rng(0), lambda: 0.0), Slam()
    core.survey = SimpleNamespace(slam=slam, scan_on_the_way=slam.scan_on_the_way)
    return core


def look(core, count=1):
    for _ in range(count):
        core._way_m += STEP_M
        at_m = core._way_m
        core.compute(
            ScanJob(
                scan=None,
                motion=None,
                odom_from_base=Pose2(at_m, 0.0, 0.0),
                at_m=at_m,
                sector=None,
            )
        )


def test_a_scan_that_doubts_the_gyro_tells_nothing_of_the_floor(core):
    core.survey.slam.off_m, core.survey.slam.was_astray = 0.04, True
    look(core, LOOKS_MIN)
    assert core.drift.per_m == 0.0


def test_drift_is_what_scans_correct_for_the_way(core):
    core.survey.slam.off_m = 0.04
    look(core, LOOKS_MIN)
    assert core.drift.per_m == pytest.approx(0.04 / STEP_M)


def test_a_moved_map_is_no_drift_and_scans_that_fit_nowhere_wait(core):
    slam = core.survey.slam
    look(core, LOOKS_MIN)
    slam.moves, slam.off_m = True, 1.0
    look(core)
    slam.moves, slam.is_located = False, False
    look(core, 3)
    slam.is_located, slam.off_m = True, 0.0
    look(core)
    assert core.drift.per_m == 0.0


def test_a_look_counts_once_it_steers_the_robot(core):
    look(core)
    assert core.last_look_m() == 0.0
    core._way_m += 0.7  # on it a scan was prepared, which is being computed
    assert core.last_look_m() == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("per_m", "drift"),
    [(0.0, DRIFT), (0.01, DRIFT), (0.03, 0.03 * DRIFT_STDS), (0.2, DRIFT_MAX)],
)
def test_a_robot_may_touch_where_it_may_have_drifted_by_the_clearance(per_m, drift):
    mission = object.__new__(Mission)
    clearance_m = 0.1
    mission._pilot = SimpleNamespace(clearance_m=lambda pose: clearance_m)
    for way_m, may_touch in (
        (0.9 * clearance_m / drift, False),
        (1.1 * clearance_m / drift, True),
    ):
        mission.core = SimpleNamespace(
            pose=None, drift=SimpleNamespace(per_m=per_m), last_look_m=lambda m=way_m: m
        )
        assert mission._may_touch() is may_touch
