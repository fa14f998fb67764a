# SPDX-License-Identifier: MIT
"""The core of a run: what happens when its recording has ended."""

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.core.run_core import RunCore
from ins_robot.estimation.slam import Slam
from ins_robot.geometry.pose2 import Pose2

MOVED = Pose2(0.04, -0.03, 0.02)


@pytest.mark.parametrize("is_moved", [True, False])
def test_when_the_map_settles_the_robot_goes_with_it(monkeypatch, is_moved: bool) -> None:
    def settle(slam: Slam) -> None:
        if is_moved:
            slam.map_moves += 1
            slam._estimator.carry(MOVED.as_array())

    monkeypatch.setattr(Slam, "settle", settle)
    core = RunCore(Config(), np.random.default_rng(0), lambda: 0.0)
    core.map_from_odom = Pose2(1.0, 2.0, 0.5)
    before = core.pose
    core.settle()
    expected = MOVED @ before if is_moved else before
    assert core.pose.as_array() == pytest.approx(expected.as_array(), abs=1e-9)
