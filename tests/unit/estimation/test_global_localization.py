# SPDX-License-Identifier: MIT
"""From nothing to a place: found where there is one answer, admitted where there is not."""

import math

import numpy as np
import pytest
from walled_map import hall, map_of, motion, room, scan_in

from ins_robot.estimation.global_localization import (
    Ambiguous,
    GlobalLocalizer,
    Located,
    Lost,
)
from ins_robot.estimation.map_fit import Beams, judge, refine
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.distance_map import DistanceMap
from ins_robot.simulation.world import World

ROOMS = World.builtin("rooms")
ROOM = room()
STEP = Pose2(0.0, 0.0, 0.5) @ Pose2(0.25, 0.0, 0.0)


def drive(world, start, count, rng):
    """(pose, scan, motion) at each of `count` places along an arc."""
    pose = start
    for k in range(count):
        step = STEP if k else Pose2()
        pose = pose @ step
        yield pose, scan_in(world, pose, rng), motion(step, rng)


def off(pose, truth):
    return pose.distance_m(truth), abs(wrap_rad(pose.heading_rad - truth.heading_rad))


def test_among_many_rooms_it_finds_itself_in_two_scans():
    rng = np.random.default_rng(1)
    localizer = GlobalLocalizer(map_of(ROOMS), Pose2())
    way = list(drive(ROOMS, Pose2(1.6, 2.2, 2.0), 2, rng))
    for _, scan, moved in way:
        verdict = localizer.step(scan, moved)
    assert isinstance(verdict, Located)
    off_m, off_rad = off(verdict.pose, way[-1][0])
    assert off_m < 0.05
    assert off_rad < math.radians(1.5)
    assert verdict.fit_share > 0.9
    assert np.linalg.eigvalsh(verdict.covariance).min() > 0.0


def test_the_lrf_may_sit_anywhere_on_the_base():
    rng = np.random.default_rng(2)
    base_from_lrf = Pose2(0.1, -0.05, 0.7)
    localizer = GlobalLocalizer(map_of(ROOM), base_from_lrf)
    for pose, _, moved in drive(ROOM, Pose2(1.5, 1.2, 0.3), 2, rng):
        verdict = localizer.step(scan_in(ROOM, pose @ base_from_lrf, rng), moved)
    assert isinstance(verdict, Located)
    assert off(verdict.pose, pose)[0] < 0.05


def test_a_symmetrical_hall_stays_ambiguous_and_names_both_places():
    rng = np.random.default_rng(3)
    world = hall()
    localizer = GlobalLocalizer(map_of(world), Pose2())
    way = list(drive(world, Pose2(2.0, 1.5, 0.4), 5, rng))
    for _, scan, moved in way:
        verdict = localizer.step(scan, moved)
        assert isinstance(verdict, Ambiguous)
    pose = way[-1][0]
    width, height = world.size_m
    twin = Pose2(width - pose.x_m, height - pose.y_m, wrap_rad(pose.heading_rad + math.pi))
    for truth in (pose, twin):
        distances = [off(Pose2.from_array(rival), truth)[0] for rival in verdict.poses]
        assert min(distances) < 0.1
    assert verdict.weights.sum() == pytest.approx(1.0, abs=0.05)


def test_the_map_of_another_building_is_not_believed():
    rng = np.random.default_rng(4)
    localizer = GlobalLocalizer(map_of(hall(3.0, 2.5)), Pose2())
    verdicts = [
        localizer.step(scan, moved)
        for _, scan, moved in drive(ROOMS, Pose2(5.0, 4.0, 0.0), 4, rng)
    ]
    assert all(isinstance(verdict, Lost) for verdict in verdicts)


def test_a_robot_carried_off_is_not_sure_until_it_is_found_again():
    rng = np.random.default_rng(5)
    localizer = GlobalLocalizer(map_of(ROOM), Pose2())
    for _, scan, moved in drive(ROOM, Pose2(1.5, 1.2, 0.3), 3, rng):
        before = localizer.step(scan, moved)
    assert isinstance(before, Located)
    found = 0
    for pose, scan, moved in drive(ROOM, Pose2(3.2, 2.6, -1.8), 9, rng):
        verdict = localizer.step(scan, moved)
        if isinstance(verdict, Located):
            assert off(verdict.pose, pose)[0] < 0.1
            found += 1
    assert found >= 3


def test_a_blind_scan_is_passed_over_and_its_motion_is_not():
    rng = np.random.default_rng(9)
    localizer = GlobalLocalizer(map_of(ROOM), Pose2())
    verdicts = []
    for k, (pose, scan, moved) in enumerate(drive(ROOM, Pose2(1.5, 1.2, 0.3), 4, rng)):
        seen = scan_in(ROOM, pose, rng, missing=1.0) if k == 2 else scan
        verdicts.append(localizer.step(seen, moved))
    assert [type(verdict) for verdict in verdicts[1:]] == [Located, Lost, Located]
    assert off(verdicts[-1].pose, pose)[0] < 0.05


def test_moving_the_map_moves_the_answer_and_nothing_else():
    poses = []
    for moved_m in ((0.0, 0.0), (-13.0, 7.5)):
        rng = np.random.default_rng(6)
        localizer = GlobalLocalizer(map_of(ROOM, moved_m), Pose2())
        for _, scan, moved in drive(ROOM, Pose2(1.5, 1.2, 0.3), 2, rng):
            verdict = localizer.step(scan, moved)
        poses.append(verdict.pose.as_array() - (*moved_m, 0.0))
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-6)


def test_a_beam_through_a_wall_has_failed():
    """Where a thin wall stands between, the reading's end still fits and its way does not."""
    is_wall = np.zeros((60, 60), dtype=bool)
    is_wall[[0, -1]] = is_wall[:, [0, -1]] = True
    is_wall[:, 30] = True
    world = World(is_wall, 0.05)
    open_world = World(np.pad(np.zeros((58, 58), dtype=bool), 1, constant_values=True), 0.05)
    pose = Pose2(0.7, 1.5, 0.0)
    scan = scan_in(open_world, pose, np.random.default_rng(7), missing=0.0)
    beams = Beams.of(scan, Pose2())
    shares = [
        judge(DistanceMap(map_of(w)), beams, pose.as_array()[None]).fit_shares[0]
        for w in (open_world, world)
    ]
    assert shares[0] > 0.98
    assert shares[1] < 0.75


def test_refinement_ends_at_the_truth_and_knows_no_more_than_the_walls_tell():
    rng = np.random.default_rng(8)
    truth = np.array([5.0, 4.0, 0.3])
    beams = Beams.of(scan_in(ROOMS, Pose2.from_array(truth), rng, std_m=0.003), Pose2())
    starts = truth + rng.uniform(-1.0, 1.0, (40, 3)) * (0.12, 0.12, math.radians(3.0))
    refined = refine(DistanceMap(map_of(ROOMS)), beams, starts, np.full(3, 1e-3))
    assert np.abs(refined.poses[:, :2] - truth[:2]).max() < 0.02
    corridor = np.ones((60, 600), dtype=bool)
    corridor[10:50] = False
    world = World(corridor, 0.05)
    along = Beams.of(scan_in(world, Pose2(15.0, 1.5, 0.0), rng), Pose2())
    seen = refine(DistanceMap(map_of(world)), along, np.array([[15.0, 1.5, 0.0]]), np.ones(3))
    assert seen.information[0, 0, 0] < 1e-3 * seen.information[0, 1, 1]
