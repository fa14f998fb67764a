# SPDX-License-Identifier: MIT
"""Each estimator behind the one protocol: better than odometry, repeatable, equivariant."""

from __future__ import annotations

import numpy as np
import pytest
from ray_world import (
    CORRIDOR,
    RING,
    ROOM,
    along_way_points,
    drive,
    full_turn,
    motion_between,
    position_errors_m,
    scan_at,
)

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.estimators import ESTIMATORS
from ins_robot.estimation.odometry_estimator import OdometryEstimator
from ins_robot.estimation.protocol import Observation
from ins_robot.estimation.similarity_estimator import SimilarityEstimator
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.mapping.surfels import surfels_of_scan

TOUR = [(0, 0), (3, 0), (3, 2), (0.5, 2), (0, 0)]
BAD_WHEELS = {"scale": 1.04, "turn_bias_rad": 0.02}
CORRECTING = sorted(set(ESTIMATORS) - {"odometry"})
FROM_FEATURES = ["similarity", "fastslam"]


def slam_with(estimator, seed=0):
    config = SlamConfig(estimator=estimator)
    return Slam(config, MapConfig(), Pose2(), np.random.default_rng(seed))


def tour(estimator, seed=1, **more):
    path = along_way_points(TOUR * 2, 0.8)
    slam = slam_with(estimator)
    return slam, drive(slam, ROOM, path, seed, motion=BAD_WHEELS, **more), path


def rms(errors):
    return float(np.sqrt((errors**2).mean()))


def test_the_table_is_the_choice_in_the_configuration():
    for name in ESTIMATORS:
        assert SlamConfig(estimator=name).estimator == name
    assert SlamConfig().estimator == "auto"


@pytest.mark.parametrize("missing", [0.0, 0.5], ids=["all beams", "half lost"])
@pytest.mark.parametrize("estimator", CORRECTING)
def test_every_estimator_beats_odometry_clearly(estimator, missing):
    _, estimates, path = tour(estimator, missing=missing)
    _, dead_reckoned, _ = tour("odometry", missing=missing)
    error = rms(position_errors_m(estimates, path))
    assert error < 0.25 * rms(position_errors_m(dead_reckoned, path))
    assert error < 0.06
    assert np.degrees(np.abs(wrap_rad((estimates - path)[:, 2]))).mean() < 1.5


@pytest.mark.parametrize("estimator", FROM_FEATURES)
def test_around_a_ring_features_hold_the_drift(estimator):
    path = along_way_points([(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (3, 0)], 1.0)
    errors = {}
    for name in (estimator, "odometry"):
        slam = slam_with(name)
        estimates = drive(slam, RING, path, 4, motion={"scale": 1.03, "turn_bias_rad": 0.01})
        errors[name] = rms(position_errors_m(estimates, path))
    assert errors[estimator] < 0.4 * errors["odometry"]


@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
def test_same_seed_same_bytes(estimator):
    one, first, _ = tour(estimator)
    two, second, _ = tour(estimator)
    assert first.tobytes() == second.tobytes()
    assert one.grid.log_odds.tobytes() == two.grid.log_odds.tobytes()


@pytest.mark.parametrize(
    ("estimator", "tolerance_m"),
    [("odometry", 1e-9), ("similarity", 1e-6), ("fastslam", 0.03), ("particle", 0.02)],
)
def test_a_rotated_world_gives_a_rotated_map(estimator, tolerance_m):
    """The map turned under the robot: all that follows is the same, turned.

    Draws are made along the map's axes, and the field has cells, hence the tolerances of the
    filters: what another seed changes.
    """
    turned = np.array([3.0, -2.0, 0.9])
    path = along_way_points(TOUR, 0.8)

    def estimates(carried):
        slam, rng, poses = slam_with(estimator), np.random.default_rng(3), []
        for i, pose in enumerate(path):
            motion = motion_between(path[max(i - 1, 0)], pose, rng if i else None)
            poses.append(
                slam.step(scan_at(ROOM, pose, rng, full_turn()), motion, Keep.ALWAYS).pose
            )
            if i == 0:
                slam._estimator.carry(carried)
                slam._nodes.graph.poses[:] = compose(carried, slam._nodes.graph.poses)
        return np.array([pose.as_array() for pose in poses[1:]]), slam.node_poses

    here, nodes_here = estimates(np.zeros(3))
    there, nodes_there = estimates(turned)
    for one, other in ((here, there), (nodes_here, nodes_there)):
        off = between(compose(turned, one), other)
        assert np.hypot(*off[:, :2].T).max() < tolerance_m
        assert np.abs(wrap_rad(off[:, 2])).max() < tolerance_m


@pytest.mark.parametrize("estimator", FROM_FEATURES)
def test_without_features_odometry_decides_and_doubt_grows(estimator):
    slam = slam_with(estimator)
    rng = np.random.default_rng(6)
    path = along_way_points([(0, 0), (5, 0)], 1.0)
    stds = []
    for i, pose in enumerate(path):
        motion = motion_between(path[max(i - 1, 0)], pose)
        estimate = slam.step(scan_at(CORRIDOR, pose, rng, full_turn()), motion, Keep.ALWAYS)
        stds.append(estimate.position_std_m)
    assert estimate.pose.x_m == pytest.approx(5.0, abs=0.05)
    assert stds[-1] > 2.0 * stds[1]


@pytest.mark.parametrize("estimator", FROM_FEATURES)
def test_doubt_is_about_what_the_error_is(estimator):
    """Not surer than right by more than three times, over a tour."""
    path = along_way_points(TOUR * 2, 0.8)
    slam = slam_with(estimator)
    rng = np.random.default_rng(2)
    squares = []
    for i, pose in enumerate(path):
        motion = motion_between(path[max(i - 1, 0)], pose, rng if i else None)
        estimate = slam.step(scan_at(ROOM, pose, rng, full_turn()), motion, Keep.ALWAYS)
        off = estimate.pose.as_array() - pose
        squares.append((off[:2] @ off[:2]) / max(estimate.position_std_m, 1e-3) ** 2)
    assert np.sqrt(np.mean(squares)) < 3.0


def test_fastslam_nodes_follow_the_particles_that_are_left():
    """Where a node was believed to be depends on what was seen later; steps become smoother."""
    path = along_way_points([(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (3, 0)], 1.0)
    truth = between(path[:-1], path[1:])
    errors = np.zeros(2)
    for seed in range(3):
        slam = slam_with("fastslam", seed)
        motion = {"scale": 1.03, "turn_bias_rad": 0.01}
        online = drive(slam, RING, path, seed, motion=motion)
        for i, poses in enumerate((slam.node_poses, online)):
            errors[i] += rms(position_errors_m(between(poses[:-1], poses[1:]), truth))
    assert errors[0] < 0.8 * errors[1]


def test_an_observation_makes_only_what_is_asked_for():
    scan = scan_at(ROOM, (0.0, 0.0, 0.0), np.random.default_rng(0), full_turn())
    surfels = surfels_of_scan(scan, 0.01, 8.0)
    asked = []
    observation = Observation(scan, Pose2(0.1, 0.0, 0.0), 0.5, surfels, lambda: asked.append(1))
    OdometryEstimator().correct(observation)
    SimilarityEstimator().correct(observation)
    assert asked == []
    assert observation.field is None
    assert observation.field is None
    assert asked == [1]
    assert len(observation.features) > 4


@pytest.mark.parametrize("estimator", ["odometry", *FROM_FEATURES])
def test_estimators_without_matches_close_no_loops(estimator):
    slam, _, _ = tour(estimator)
    assert slam.loop_closures == 0
