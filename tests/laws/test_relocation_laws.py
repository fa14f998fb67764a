# SPDX-License-Identifier: MIT
"""A robot that was carried goes on where it was put down, and its map does not notice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ray_world import ROOM, along_way_points, drive, full_turn, motion_between, scan_at

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.core.trajectory import Anchor, TrajectoryRecorder
from ins_robot.core.whereabouts import Here, PutDown, Unknown, Whereabouts
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose

TOUR = along_way_points([(0, 0), (3, 0), (3, 2), (0.5, 2)], 1.0)
THERE = np.array([-1.0, 0.3, 2.0])
SURE = np.diag([1e-4, 1e-4, 1e-4])


def toured(estimator="particle"):
    slam = Slam(SlamConfig(estimator=estimator), MapConfig(), Pose2(), np.random.default_rng(0))
    drive(slam, ROOM, TOUR, 1)
    return slam


def seen(pose, seed=2, walls=ROOM):
    return scan_at(walls, pose, np.random.default_rng(seed), full_turn(), stamp_s=90.0)


def off_m_and_rad(slam, true):
    off = slam.pose.as_array() - true
    return math.hypot(off[0], off[1]), abs(float(wrap_rad(off[2])))


@pytest.mark.parametrize("estimator", ["particle", "similarity", "fastslam", "odometry"])
def test_it_goes_on_from_where_it_was_put_down_and_the_map_stays(estimator):
    slam = toured(estimator)
    before, edges = slam.node_poses, slam._nodes.graph.edge_count
    slam.relocate(seen(THERE), Pose2.from_array(THERE), SURE)
    assert len(slam.nodes) == len(before) + 1
    at_m, at_rad = off_m_and_rad(slam, THERE)
    assert (at_m < 0.05, at_rad < math.radians(1.5)) == (True, True)
    assert np.hypot(*(slam.node_poses[:-1] - before)[:, :2].T).max() < 0.02
    new = slam._nodes.graph._ends.all[edges:]
    last = len(before) - 1
    nearest = slam._nodes.nearest(np.arange(len(before)), THERE)
    assert nearest != last  # so an edge to `last` could only come of the odometry
    assert len(new) >= 1
    assert (new[0] == (nearest, last + 1)).all()
    further = compose(THERE, np.array([0.3, 0.0, 0.2]))
    slam.step(seen(further, 3), motion_between(THERE, further), Keep.ALWAYS)
    assert off_m_and_rad(slam, further)[0] < 0.06


def test_the_wheels_are_not_blamed_for_the_carrying():
    slam = toured()
    assert slam._wheel_scale._l
    slam.relocate(seen(THERE), Pose2.from_array(THERE), SURE)
    assert len(slam._wheel_scale._r) == 1
    np.testing.assert_allclose(slam._wheel_scale._r[0], THERE[:2], atol=0.05)


def test_whatever_the_way_there_the_place_is_the_same():
    """Relocating forgets what the odometry claims of the carrying, but not the map."""
    poses = []
    for claimed in ([0.0, 0.0, 0.0], [2.0, -1.0, 3.0]):
        slam = toured()
        slam._since_node = motion_between(np.zeros(3), np.array(claimed))
        slam.relocate(seen(THERE), Pose2.from_array(THERE), SURE)
        poses.append((slam.pose.as_array(), slam.node_poses))
    np.testing.assert_array_equal(poses[0][0], poses[1][0])
    np.testing.assert_array_equal(poses[0][1], poses[1][1])


def looks(slam, true, walls=ROOM, count=3, claimed=(0.0, 0.0, 0.0)):
    """What looks at `true` tell, when the odometry claims to have moved so far."""
    whereabouts = Whereabouts(slam, Pose2())
    motion = motion_between(np.zeros(3), np.array(claimed), std=(0.005, 0.005, 0.003))
    return [
        whereabouts.look(seen(true, seed, walls), motion, slam.grid)
        for seed in range(10, 10 + count)
    ]


def test_a_look_tells_left_alone_from_nudged_and_carried():
    slam = toured()
    before = slam.pose, slam.node_poses, slam.grid.log_odds.copy()
    here = TOUR[-1]
    nudged = compose(here, np.array([0.2, 0.1, math.radians(10.0)]))
    assert isinstance(looks(slam, here)[0], Here)
    (found,) = looks(slam, nudged, count=1)
    assert isinstance(found, PutDown)
    assert found.pose.distance_m(Pose2.from_array(nudged)) < 0.03
    first, second, _ = looks(slam, THERE)
    assert isinstance(first, Unknown)  # one look is not enough, anywhere
    assert isinstance(second, PutDown)
    off = between(second.pose.as_array(), THERE)
    assert np.hypot(off[0], off[1]) < 0.03
    assert (slam.pose, len(slam.nodes)) == (before[0], len(before[1]))
    assert (slam.grid.log_odds == before[2]).all()


def test_another_building_and_a_covered_lrf_are_nowhere():
    slam = toured()
    hut = np.array([(-1.0, -0.6, 5.0, -0.6), (-1.0, 0.7, 5.0, 0.7), (3.0, -2.0, 3.0, 2.0)])
    for found in looks(slam, np.zeros(3), hut):
        assert isinstance(found, Unknown)
        assert "map" in found.advice(Pose2(1.0, 2.0))
        assert "x 1.0 m, y 2.0 m" in found.advice(Pose2(1.0, 2.0))
    (found,) = looks(slam, np.zeros(3), np.array([(90.0, 90.0, 91.0, 91.0)]), 1)
    assert isinstance(found, Unknown)
    assert "covered" in found.why


def test_of_a_carrying_the_trajectory_tells_nothing_and_nothing_is_smeared():
    recorder = TrajectoryRecorder()
    for k in range(21):  # drives 1 m in 10 s, is carried from 10 s to 14 s, drives on
        recorder.add(float(k), Pose2(0.1 * min(k, 10) + 0.1 * max(0, k - 14), 0.0, 0.0))
    anchors = [
        Anchor(stamp_s=0.0, odom_from_base=Pose2(), map_from_base=Pose2()),
        Anchor(stamp_s=14.0, odom_from_base=Pose2(1.0), map_from_base=Pose2(7.0, 3.0)),
    ]
    stamps_s, poses = recorder.corrected(anchors, [(10.0, 14.0)])
    assert stamps_s.tolist() == [*range(11), *range(14, 21)]
    np.testing.assert_allclose(poses[:11, 0], 0.1 * np.arange(11), atol=1e-9)
    np.testing.assert_allclose(poses[11:, 0], 7.0 + 0.1 * np.arange(7), atol=1e-9)
    np.testing.assert_allclose(poses[11:, 1], 3.0, atol=1e-9)
