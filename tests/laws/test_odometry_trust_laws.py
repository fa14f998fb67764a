# SPDX-License-Identifier: MIT
"""What odometry is worth: as much as the scans say, and no more where they are silent."""

from __future__ import annotations

import numpy as np
import pytest

from ins_robot.estimation.odometry_trust import TURN_FACTOR_MIN, Innovation, OdometryTrust
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.geometry.pose2 import Pose2, compose
from ins_robot.messages import REPEATED_UNKNOWN, MotionIncrement

ASSUMED = np.diag([0.05**2, 0.005**2, 0.06**2])
SURE = np.diag([1e5, 1e5, 1e6])
START_COVARIANCE = np.diag([1e-6, 1e-6, 1e-7])


def motion(delta: Pose2) -> MotionIncrement:
    return MotionIncrement(from_stamp_s=0.0, to_stamp_s=1.0, delta=delta, covariance=ASSUMED)


def laid(pose: np.ndarray, information: np.ndarray) -> Alignment:
    return Alignment(
        pose=pose,
        information=information,
        gradient=np.zeros(3),
        inlier_share=0.9,
        inliers=100,
        cost=0.0,
        is_inlier=np.ones(100, bool),
        by_source={},
    )


def drive(
    trust: OdometryTrust, factor: float, steps: int, seed: int, sure: float = 1.0
) -> None:
    """Steps whose odometry errs by `factor` times the variance that is assumed."""
    rng = np.random.default_rng(seed)
    step, pose = motion(Pose2(0.5, 0.0, 1.4)), np.array([1.0, 2.0, 0.5])
    for _ in range(steps):
        error = rng.standard_normal(3) * np.sqrt(factor * np.diag(ASSUMED))
        true = compose(pose, step.delta.as_array() + error)
        match = laid(true, sure * SURE)
        trust.learn(step, Innovation.of(match, pose, START_COVARIANCE, step))
        pose = true


@pytest.mark.parametrize("factor", [1.0, 4.0, 25.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_factor_is_found(factor: float, seed: int) -> None:
    trust = OdometryTrust()
    drive(trust, factor, 150, seed)
    assert factor / 2.0 < trust.factor < 2.0 * factor


def test_odometry_that_gets_worse_is_noticed() -> None:
    trust = OdometryTrust()
    drive(trust, 1.0, 300, seed=1)
    drive(trust, 36.0, 300, seed=2)
    assert trust.factor > 9.0


def test_scans_that_say_nothing_leave_it_as_it_was() -> None:
    trust, first = OdometryTrust(), OdometryTrust().factor
    drive(trust, 1.0, 500, seed=1, sure=1e-9)
    trust.learn(motion(Pose2(0.5)), None)
    assert trust.factor == first


def test_after_scans_that_say_nothing_one_alone_decides_nothing() -> None:
    trust, first = OdometryTrust(), OdometryTrust().factor
    drive(trust, 1.0, 1500, seed=1, sure=1e-9)
    drive(trust, 1.0, 1, seed=3)
    assert trust.factor == first


def test_who_stands_still_proves_nothing() -> None:
    trust, first = OdometryTrust(), OdometryTrust().factor
    still, pose = motion(Pose2(0.001, 0.0, 0.0)), np.zeros(3)
    for _ in range(200):
        match = laid(compose(pose, still.delta.as_array()), SURE)
        trust.learn(still, Innovation.of(match, pose, START_COVARIANCE, still))
    assert trust.factor == first


def test_a_few_scans_laid_wrong_do_not_spoil_it() -> None:
    trust = OdometryTrust()
    drive(trust, 1.0, 200, seed=1)
    for _ in range(5):
        drive(trust, 400.0, 1, seed=2)
        drive(trust, 1.0, 20, seed=3)
    assert trust.factor < 4.0


def test_a_short_motion_is_worth_less_since_its_error_repeats() -> None:
    trust = OdometryTrust()
    drive(trust, 1.0, 200, seed=1)
    worth = [trust.expect(motion(Pose2(way, 0.0, 0.0))).repeated for way in (0.01, 0.5, 3.0)]
    assert worth[0] == REPEATED_UNKNOWN
    assert worth[0] > worth[1] > worth[2]


@pytest.mark.parametrize("factor", [1.0, 25.0])
def test_the_heading_is_never_trusted_as_much_as_good_ways_suggest(factor: float) -> None:
    trust = OdometryTrust()
    drive(trust, factor, 200, seed=1)
    expected = trust.expect(motion(Pose2(3.0)))
    worth = expected.repeated * expected.covariance / np.where(ASSUMED, ASSUMED, 1.0)
    assert worth[0, 0] == pytest.approx(trust.factor)
    assert worth[1, 1] == pytest.approx(trust.factor)
    assert worth[2, 2] == pytest.approx(max(trust.factor, TURN_FACTOR_MIN))
