# SPDX-License-Identifier: MIT
"""The ring, and the covariance from running sums against the sum written out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ins_robot.core.pose_history import BiasDoubt, PoseHistory
from ins_robot.errors import StateError
from ins_robot.messages import VelocityCommand

STILL = VelocityCommand()


def test_running_sums_equal_the_sum_over_the_way() -> None:
    rng = np.random.default_rng(4)
    history = PoseHistory()
    pose = np.array([30.0, -20.0, 2.0])  # far from the origin: no digits must be lost
    steps = []
    for k in range(400):
        s, w, t = float(rng.uniform(0, 1e-6)), float(rng.uniform(0, 1e-7)), 0.02
        history.append(
            0.02 * k, tuple(pose.tolist()), position_var=s, heading_var=w, gyro_time_s=t
        )
        steps.append((pose.copy(), s, w, t))
        pose = pose + rng.normal(0, [0.02, 0.02, 0.05])
    first, middle, last = 100, 220, 350
    bias_std, earlier_std = 1e-3, 4e-3
    end = steps[last][0]
    expected, bias_effect, earlier_effect = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for k, (p, s, w, t) in enumerate(steps[first + 1 : last + 1], first + 1):
        lever = np.array([-(end[1] - p[1]), end[0] - p[0], 1.0])
        expected += np.diag([s, s, 0.0]) + w * np.outer(lever, lever)
        bias_effect += t * lever
        earlier_effect += t * lever * (k <= middle)
    expected += bias_std**2 * np.outer(bias_effect, bias_effect)
    expected += earlier_std**2 * np.outer(earlier_effect, earlier_effect)
    heading = steps[first][0][2]
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    doubts = [BiasDoubt(2.0, math.inf, bias_std), BiasDoubt(3.0, 0.02 * middle, earlier_std)]
    motion = history.increment(0.02 * first, 0.02 * last, STILL, doubts)
    np.testing.assert_allclose(
        motion.covariance, turn @ expected @ turn.T, rtol=1e-6, atol=1e-14
    )


def test_the_newest_are_kept_and_of_the_rest_enough_to_ask_from_the_first_on() -> None:
    history = PoseHistory(rows=125)
    for k in range(100_000):
        history.append(float(k), (0.1 * k, 0.0, 0.0), position_var=0.5)
    assert len(history) <= 125
    stamps_s = np.array([99_940.0, 99_999.0, 99_950.25, 17.0, 60_000.5])
    np.testing.assert_allclose(history.poses_at(stamps_s, STILL)[:, 0], 0.1 * stamps_s)
    whole = history.increment(0.0, 99_999.0, STILL, ())
    assert whole.covariance[0, 0] == pytest.approx(0.5 * 99_999)
    with pytest.raises(StateError, match="history begins at 0"):
        history.increment(-1.0, 99_999.0, STILL, ())


def test_last_row_can_be_replaced() -> None:
    history = PoseHistory()
    for k in range(10):
        history.append(float(k), (1.0, 2.0, 0.0), position_var=1.0, replaces_last=k >= 2)
    assert len(history) == 2
    assert history.increment(0.0, 9.0, STILL, ()).covariance[0, 0] == pytest.approx(9.0)


def test_empty_history_says_so() -> None:
    with pytest.raises(StateError, match="no wheel sample"):
        PoseHistory().poses_at(np.array([0.0]), STILL)
    with pytest.raises(StateError, match="no wheel sample"):
        PoseHistory().increment(0.0, 1.0, STILL, ())
