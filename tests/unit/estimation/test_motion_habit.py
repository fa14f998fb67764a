# SPDX-License-Identifier: MIT
"""The next motion guessed by the last ones."""

import numpy as np
import pytest

from ins_robot.estimation.motion_habit import SCANS_MIN, WAY_STD_M, MotionHabit
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import MotionIncrement

UNKNOWN = MotionIncrement(
    from_stamp_s=0.0, to_stamp_s=1.0, delta=Pose2(), covariance=np.diag([0.16, 0.16, 0.25])
)


def habit_of(ways):
    habit = MotionHabit()
    for x_m, y_m in ways:
        habit.learn(Pose2(x_m, y_m, 0.3))
    return habit


def test_before_enough_was_seen_the_motion_is_as_told():
    assert habit_of([(0.3, 0.0)] * (SCANS_MIN - 1)).expect(UNKNOWN) == UNKNOWN


def test_steady_ways_go_on_and_the_turn_is_left_open():
    expected = habit_of([(0.3, 0.1)] * SCANS_MIN).expect(UNKNOWN)
    assert expected.delta.as_array() == pytest.approx([0.3, 0.1, 0.0])
    assert np.diag(expected.covariance) == pytest.approx([WAY_STD_M**2, WAY_STD_M**2, 0.25])


def test_unsteady_ways_are_doubted_where_they_vary():
    rng = np.random.default_rng(0)
    ways = np.column_stack([0.3 + 0.2 * rng.standard_normal(40), np.zeros(40)])
    covariance = habit_of(ways).expect(UNKNOWN).covariance
    assert covariance[0, 0] > 4 * covariance[1, 1]


def test_what_lies_long_back_is_forgotten():
    expected = habit_of([(2.0, 0.0)] * 30 + [(0.1, 0.0)] * 30).expect(UNKNOWN)
    assert expected.delta.x_m == pytest.approx(0.1)
