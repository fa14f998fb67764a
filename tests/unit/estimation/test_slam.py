# SPDX-License-Identifier: MIT
"""The façade in small worlds: it knows where it is, or says that it does not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ray_world import (
    CORRIDOR,
    ROOM,
    along_way_points,
    box,
    drive,
    full_turn,
    motion_between,
    position_errors_m,
    scan_at,
)

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, compose

TOUR = [(0, 0), (3, 0), (3, 2), (0.5, 2), (0, 0)]
AROUND = [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (3, 0)]
BAD_WHEELS = {"scale": 1.04, "turn_bias_rad": 0.02}


def slam_with(**options):
    return Slam(SlamConfig(**options), MapConfig(), Pose2(), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("bearings", "missing"),
    [
        (full_turn(360), 0.0),
        (full_turn(360), 0.5),
        (full_turn(660), 0.2),
        (np.radians(np.arange(-90, 91)), 0.0),
        (np.radians(np.arange(-90, 91)), 0.5),
        (np.radians(np.arange(-150, 151)), 0.3),
    ],
    ids=["360", "half lost", "660", "half turn", "half turn, half lost", "sector"],
)
def test_stop_and_scan_with_bad_wheels_is_placed_for_any_geometry(bearings, missing):
    path = along_way_points(TOUR, 1.0)
    estimates = drive(
        slam_with(), ROOM, path, 1, motion=BAD_WHEELS, bearings=bearings, missing=missing
    )
    errors = position_errors_m(estimates, path)
    assert np.sqrt((errors**2).mean()) < 0.04
    assert np.degrees(np.abs(wrap_rad((estimates - path)[:, 2]))).max() < 1.5


def test_odometry_estimator_corrects_nothing_and_knows_that_it_drifts():
    path = along_way_points(TOUR, 1.0)
    slam = slam_with(estimator="odometry")
    estimates = drive(slam, ROOM, path, 1, motion=BAD_WHEELS)
    assert position_errors_m(estimates, path)[-1] > 0.15
    assert slam.loop_closures == 0
    assert slam.grid.is_occupied.any()
    assert len(slam.nodes) == len(path)


def test_continuous_scans_become_nodes_by_distance_and_turn():
    path = along_way_points([(0, 0), (3, 0)], 0.1)
    slam = slam_with(node_distance_m=0.5)
    drive(slam, ROOM, path, 2, keep=Keep.APART, motion={"std": (0.01, 0.01, 0.005)})
    assert len(slam.nodes) == pytest.approx(7, abs=1)
    turning = np.array([(0.0, 0.0, math.radians(5.0 * k)) for k in range(19)])
    slam = slam_with(node_turn_deg=20.0)
    drive(slam, ROOM, turning, 3, keep=Keep.APART, motion={"std": (0.005, 0.005, 0.01)})
    assert len(slam.nodes) == pytest.approx(5, abs=1)


def test_rooms_that_look_alike_are_not_taken_for_one():
    """Four equal rooms on one corridor: nothing is closed on the way out."""
    rooms = [wall for k in range(4) for wall in box(5.0 * k - 1.5, 1.0, 5.0 * k + 1.5, 4.0)[1:]]
    walls = np.array([*rooms, (-3, -1, 18, -1), (-3, -1, -3, 1), (18, -1, 18, 1)])
    path = along_way_points(
        [(0, 0), (0.5, 0), (0, 2), (0, 0), (5, 0), (5, 2), (5, 0), (10, 0)], 1
    )
    slam = slam_with()
    estimates = drive(slam, walls, path, 5, motion=BAD_WHEELS)
    assert position_errors_m(estimates, path).max() < 0.25
    assert slam.loop_closures == 0


def test_along_a_bare_corridor_odometry_decides_and_doubt_grows_only_there():
    path = along_way_points([(0, 0), (8, 0)], 1.0)
    slam = slam_with()
    rng = np.random.default_rng(6)
    for i, pose in enumerate(path):
        motion = motion_between(path[max(i - 1, 0)], pose, rng if i else None)
        estimate = slam.step(scan_at(CORRIDOR, pose, rng, full_turn()), motion, Keep.ALWAYS)
    assert estimate.pose.x_m == pytest.approx(8.0, abs=0.35)
    assert estimate.pose.y_m == pytest.approx(0.0, abs=0.03)
    assert estimate.covariance[0, 0] > 20.0 * estimate.covariance[1, 1]


def test_when_the_scan_matches_badly_odometry_decides_and_doubt_grows():
    slam = slam_with()
    path = along_way_points([(0, 0), (1.0, 0)], 0.5)
    drive(slam, ROOM, path, 7)
    before = slam.step(
        scan_at(ROOM, path[-1], np.random.default_rng(1), full_turn()),
        motion_between(path[-1], path[-1]),
        Keep.NEVER,
    )
    rng = np.random.default_rng(8)
    start = slam.pose.as_array()
    for _ in range(3):
        noise = scan_at(ROOM, (0, 0, 0), rng, full_turn())
        garbled = type(noise)(
            stamp_s=9.0,
            bearings_rad=np.array(noise.bearings_rad),
            ranges_m=rng.uniform(0.2, 1.2, 360),
            range_std_m=np.full(360, 0.01),
            beam_offsets_s=np.zeros(360),
            range_max_m=6.0,
        )
        estimate = slam.step(garbled, motion_between((0, 0, 0), (0.3, 0, 0)), Keep.NEVER)
    expected = compose(start, [0.9, 0.0, 0.0])
    assert np.hypot(*(estimate.pose.as_array() - expected)[:2]) < 0.03
    assert estimate.position_std_m > 2.0 * before.position_std_m
    assert estimate.position_std_m > 0.05


def test_empty_scans_are_survived():
    slam = slam_with()
    empty = scan_at(ROOM, (0, 0, 0), np.random.default_rng(0), full_turn(), missing=1.1)
    for _ in range(3):
        estimate = slam.step(empty, motion_between((0, 0, 0), (0.5, 0, 0)))
    assert estimate.pose.x_m == pytest.approx(1.5, abs=0.05)
    assert slam.grid.is_unknown.all()


def test_anchors_follow_the_corrections_of_their_nodes():
    path = along_way_points(TOUR, 0.25)
    slam = slam_with()
    estimates = drive(slam, ROOM, path, 9, keep=Keep.APART)
    poses = slam.node_poses
    told = [compose(poses[a.node_id], a.node_from_base.as_array()) for a in slam.anchors]
    assert len(told) == len(path)
    assert position_errors_m(np.array(told), estimates).max() < 0.05
    assert [a.stamp_s for a in slam.anchors] == sorted(a.stamp_s for a in slam.anchors)


@pytest.mark.parametrize("turn_deg", [-30.0, -10.0, 10.0, 30.0])
def test_a_scan_turned_far_beyond_what_the_motion_claims_is_placed_and_told(turn_deg):
    """As after a step of the gyro's bias; the motion claims a heading good to 0.3 deg."""
    slam = slam_with()
    path = along_way_points([(0, 0), (2, 0)], 0.5)
    drive(slam, ROOM, path, 1, motion={"std": (0.01, 0.01, 0.005)})
    assert not slam.was_astray
    claimed = {"std": (0.02, 0.02, math.radians(0.3)), "turn_bias_rad": math.radians(turn_deg)}
    rng = np.random.default_rng(3)
    there = np.array([2.5, 0.3, 0.4])
    motion = motion_between(path[-1], there, rng, **claimed)
    estimate = slam.step(scan_at(ROOM, there, rng, full_turn()), motion, Keep.ALWAYS)
    off = np.array(estimate.pose.as_array() - there)
    assert slam.was_astray
    assert math.hypot(off[0], off[1]) < 0.05
    assert abs(math.degrees(wrap_rad(off[2]))) < 1.5
    slam.step(
        scan_at(ROOM, there, rng, full_turn()), motion_between(there, there, rng), Keep.NEVER
    )
    assert not slam.was_astray


@pytest.mark.parametrize("set_back_m", [0.5, 0.6])
def test_one_wall_fits_another_anywhere_and_does_not_overrule_the_motion(set_back_m):
    """A recess that is not on the map yet does not tell that the robot is elsewhere."""
    slam = slam_with()
    wall = np.array([(-4.0, 2.0, 4.0, 2.0)])
    drive(slam, wall, along_way_points([(0, 0), (0.5, 0)], 0.5), 1)
    recess = np.array([(0.2, 2.0 + set_back_m, 1.8, 2.0 + set_back_m)])
    before, there = np.array([0.5, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    rng = np.random.default_rng(2)
    motion = motion_between(before, there, rng, std=(0.02, 0.02, math.radians(0.3)))
    estimate = slam.step(scan_at(recess, there, rng, full_turn()), motion, Keep.ALWAYS)
    assert not slam.was_astray
    off = np.array(estimate.pose.as_array() - there)
    assert np.abs(off[:2]).max() < 0.1
    assert abs(off[2]) < math.radians(2.0)
