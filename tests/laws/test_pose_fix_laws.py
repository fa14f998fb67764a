# SPDX-License-Identifier: MIT
"""Laws of the pose by pairs of features and landmarks: right, honest, and refusing."""

from __future__ import annotations

import numpy as np
import pytest

from ins_robot.estimation.correspondence import Correspondence
from ins_robot.estimation.pose_fix import fix_pose
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, compose

PRIOR = np.diag([0.1**2, 0.1**2, 0.08**2])
TRUTH = np.array([1.0, -2.0, 0.6])


def pairs_of(expected, landmarks_m, rng=None, std_m=0.02, turn_std=0.03):
    """Pairs as seen from TRUTH when the base was expected elsewhere."""
    seen_m = Pose2.from_array(TRUTH).inverse().apply(landmarks_m)
    turns = np.full(len(seen_m), wrap_rad(float(TRUTH[2] - expected[2])))
    if rng is not None:
        seen_m = seen_m + rng.normal(0.0, std_m, seen_m.shape)
        turns = turns + rng.normal(0.0, turn_std, len(turns))
    return Correspondence(
        features=np.arange(len(seen_m)),
        landmarks=np.arange(len(seen_m)),
        placed_m=Pose2.from_array(expected).apply(seen_m),
        std_m=np.full(len(seen_m), std_m),
        turns_rad=turns,
        turn_vars=np.full(len(seen_m), turn_std**2),
    )


def around(rng, count):
    return TRUTH[:2] + rng.uniform(-3.0, 3.0, (count, 2))


@pytest.mark.parametrize("seed", range(10))
def test_exact_pairs_outvote_the_prediction(seed):
    rng = np.random.default_rng(seed)
    landmarks_m = around(rng, 8)
    expected = compose(TRUTH, rng.normal(0.0, [0.1, 0.1, 0.08]))
    fix = fix_pose(pairs_of(expected, landmarks_m), landmarks_m, expected, PRIOR)
    assert np.hypot(*(fix.pose - TRUTH)[:2]) < 0.01
    assert abs(wrap_rad(float(fix.pose[2] - TRUTH[2]))) < 0.01
    assert (np.linalg.eigvalsh(fix.covariance) > 0.0).all()


def test_errors_are_those_of_the_covariance():
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(300):
        landmarks_m = around(rng, 6)
        off = rng.normal(0.0, [0.1, 0.1, 0.08])
        expected = TRUTH + off
        fix = fix_pose(pairs_of(expected, landmarks_m, rng), landmarks_m, expected, PRIOR)
        miss = fix.pose - TRUTH
        squares.append(miss @ np.linalg.inv(fix.covariance) @ miss)
    assert 1.5 < np.mean(squares) < 3.6  # three when exact; floors make it less


def test_one_pair_tells_the_heading_only_and_none_tells_nothing():
    landmark_m = np.array([[3.0, 1.0]])
    expected = TRUTH + np.array([0.1, -0.1, 0.1])
    fix = fix_pose(pairs_of(expected, landmark_m), landmark_m, expected, PRIOR)
    assert fix.pose[:2] == pytest.approx(expected[:2])
    assert abs(fix.pose[2] - TRUTH[2]) < 0.02
    nothing = landmark_m[:0]
    assert fix_pose(pairs_of(expected, nothing), nothing, expected, PRIOR) is None


def test_pairs_that_need_another_scale_or_an_incredible_jump_are_refused():
    rng = np.random.default_rng(2)
    landmarks_m = around(rng, 8)
    blind = pairs_of(TRUTH, landmarks_m, turn_std=3.0)
    assert fix_pose(blind, TRUTH[:2] + 1.2 * (landmarks_m - TRUTH[:2]), TRUTH, PRIOR) is None
    assert fix_pose(blind, landmarks_m + np.array([1.0, 0.0]), TRUTH, PRIOR) is None
    assert fix_pose(blind, landmarks_m, TRUTH, PRIOR) is not None
