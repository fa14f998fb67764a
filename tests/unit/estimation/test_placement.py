# SPDX-License-Identifier: MIT
"""A scan whose place is hardly known is found where it fits, and refused where it does not."""

from __future__ import annotations

import math

import numpy as np
from ray_world import CORRIDOR, ROOM, drive, full_turn, motion_between, scan_at

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.placement import Misfit
from ins_robot.estimation.slam import Slam
from ins_robot.geometry.pose2 import Pose2, compose
from ins_robot.messages import MotionIncrement

DOUBT = (0.3, 0.3, math.radians(20.0))
PLACES = np.array([(0.0, 0.0, 0.0), (1.0, 0.5, 0.5), (-1.0, 1.5, 2.0), (3.0, 0.0, -2.0)])


def slam_in(walls, places=PLACES):
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(0))
    drive(slam, walls, np.asarray(places), 1)
    return slam


def asked(slam, walls, true, said, seed=2):
    """What `place` says of a scan at `true` when a person says it is at `said`."""
    scan = scan_at(walls, true, np.random.default_rng(seed), full_turn(), stamp_s=9.0)
    return slam.place(scan, motion_between(slam.pose.as_array(), said, std=DOUBT))


def refusal(slam, walls, true, said=None):
    """Why `place` lays the scan nowhere."""
    misfit = asked(slam, walls, true, true if said is None else said)
    assert isinstance(misfit, Misfit), misfit
    return misfit.why


def test_a_scan_is_found_decimetres_and_tens_of_degrees_from_where_it_is_said_to_be():
    rng = np.random.default_rng(3)
    slam = slam_in(ROOM)
    for _ in range(20):
        true = np.array([rng.uniform(-1.2, 1.2), rng.uniform(-0.5, 2.5), rng.uniform(-3, 3)])
        said = true + rng.normal(0.0, DOUBT)
        motion = asked(slam, ROOM, true, said)
        assert isinstance(motion, MotionIncrement), motion
        found = compose(slam.pose.as_array(), motion.delta.as_array())
        assert np.hypot(*(found - true)[:2]) < 0.02
        assert abs(math.sin(found[2] - true[2])) < math.radians(0.7)
        assert math.sqrt(np.trace(motion.covariance[:2, :2])) < 0.03


def test_nothing_is_changed_by_asking():
    slam = slam_in(ROOM)
    before = slam.pose, slam.node_poses, slam.grid.log_odds.copy(), len(slam.anchors)
    there, elsewhere = PLACES[1] + [0.2, 0.0, 0.1], PLACES[1] + [2.5, 0.0, 2.0]
    assert isinstance(asked(slam, ROOM, PLACES[1], there), MotionIncrement)
    assert isinstance(asked(slam, ROOM, PLACES[1], elsewhere), Misfit)
    assert slam.pose == before[0]
    assert (slam.node_poses == before[1]).all()
    assert (slam.grid.log_odds == before[2]).all()
    assert len(slam.anchors) == before[3]


def test_a_scan_of_another_building_or_of_nothing_is_refused():
    slam = slam_in(ROOM)
    elsewhere = np.array(
        [(-1.0, -0.6, 5.0, -0.6), (-1.0, 0.7, 5.0, 0.7), (3.0, -2.0, 3.0, 2.0)]
    )
    assert "of the readings contradict the map, 6% at most" in refusal(
        slam, elsewhere, np.zeros(3)
    )
    assert refusal(slam, ROOM + 100.0, np.zeros(3)) == "0 usable readings, 30 are needed"


def test_along_a_bare_corridor_a_place_is_refused_rather_than_guessed():
    slam = slam_in(CORRIDOR, [(0.0, 0.0, 0.0)])
    assert "along the walls that it sees it may slide by" in refusal(
        slam, CORRIDOR, (2.0, 0.0, 0.0), (2.3, 0.1, 0.1)
    )


def test_the_first_scan_needs_no_map_but_readings():
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(0))
    motion = asked(slam, ROOM, np.zeros(3), np.zeros(3))
    assert isinstance(motion, MotionIncrement)
    assert motion.delta == Pose2()
    assert refusal(slam, ROOM + 100.0, np.zeros(3)) == "0 usable readings, 30 are needed"
