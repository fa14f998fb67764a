# SPDX-License-Identifier: MIT
"""Laws of landmark maps and of finding features among them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.estimation.correspondence import correspond
from ins_robot.estimation.landmarks import NEW, UNCLEAR, LandmarkMaps, Sightings
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.mapping.features import Features

SURE = np.zeros((3, 3))
LANDMARKS = np.array([(2.0, 0.5), (-1.0, 2.0), (0.5, -2.5), (3.0, 3.0), (-2.0, -1.5)])
KINDS = np.array([0, 0, 1, 1, 3])
HEADINGS = np.array([0.5, -2.0, 3.0, 1.0, 0.0])


def features_from(pose, rng=None, points_m=LANDMARKS, kinds=KINDS, std_m=0.01):
    placed = Pose2.from_array(pose).inverse().apply(points_m)
    if rng is not None:
        placed = placed + rng.normal(0.0, std_m, placed.shape)
    covariances = np.tile(np.eye(2) * std_m**2, (len(placed), 1, 1))
    headings = np.resize(HEADINGS, len(placed)) - pose[2]
    if rng is not None:
        headings = headings + rng.normal(0.0, 0.02, len(placed))
    return Features(
        points_m=placed,
        covariances=covariances,
        kinds=kinds,
        headings_rad=wrap_rad(headings),
        heading_vars=np.full(len(placed), 0.02**2),
    )


def look(maps, poses, features, doubt=SURE):
    sightings = Sightings.of(features)
    slots = maps.near(poses.mean(axis=0), 20.0)
    chosen = maps.associate(poses, sightings, slots, doubt)
    maps.learn(poses, sightings, chosen, doubt)
    return chosen


def test_what_was_seen_is_known_again_by_each_particle_for_itself():
    poses = np.array([(0.0, 0.0, 0.0), (1.0, -0.5, 0.4), (0.2, 0.3, -3.0)])
    maps = LandmarkMaps(3, 16)
    seen = features_from(poses[0])
    assert (look(maps, poses, seen) == NEW).all()
    step = np.array([0.4, 0.2, 0.5])
    chosen = look(maps, compose(poses, step), features_from(compose(poses[0], step)))
    assert chosen.tolist() == [[0, 1, 2, 3, 4]] * 3
    for particle, pose in enumerate(poses):  # each map is rigid with its particle's start
        assert Pose2.from_array(pose).inverse().apply(maps.points_m[particle, :5]) == (
            pytest.approx(LANDMARKS, abs=1e-6)
        )


def test_a_landmark_seen_often_becomes_right_and_sure():
    rng = np.random.default_rng(0)
    maps = LandmarkMaps(1, 16)
    for _ in range(60):
        pose = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3)])
        look(maps, pose[None], features_from(pose, rng, std_m=0.05))
    off = maps.points_m[0, :5] - LANDMARKS
    std = np.sqrt(0.5 * np.trace(maps.covariances[0, :5], axis1=1, axis2=2))
    assert (maps.seen[0, :5] >= 57).all()
    assert (std < 0.02).all()
    assert (np.hypot(*off.T) < 4.0 * std).all()
    turn = wrap_rad(maps.headings_rad[0, :5] - HEADINGS)
    assert (np.abs(turn) < 4.0 * np.sqrt(maps.heading_vars[0, :5])).all()
    assert (maps.heading_vars[0, :5] < 0.004**2).all()


def test_a_landmark_is_taken_by_one_feature_and_kinds_do_not_mix():
    maps = LandmarkMaps(1, 16)
    origin = np.zeros((1, 3))
    look(maps, origin, features_from(origin[0]))
    twins = LANDMARKS[0] + np.array([[0.0, 0.0], [0.02, 0.0]])
    seen = features_from(origin[0], points_m=twins, kinds=KINDS[:2])
    chosen = look(maps, origin, replace(seen, headings_rad=np.full(2, HEADINGS[0])))
    assert chosen.tolist() == [[0, UNCLEAR]]
    swapped = features_from(origin[0], points_m=LANDMARKS[:1], kinds=np.array([2]))
    assert look(maps, origin, swapped).tolist() == [[NEW]]
    turned = replace(features_from(origin[0]), headings_rad=HEADINGS + 1.0)
    assert (look(maps, origin, turned) == NEW).all()


def test_a_full_map_gives_up_the_least_seen():
    maps = LandmarkMaps(2, 4)
    origin = np.zeros((2, 3))
    for _ in range(3):
        look(maps, origin, features_from(origin[0], points_m=LANDMARKS[:3], kinds=KINDS[:3]))
    for angle in np.linspace(0.0, 6.0, 9):
        far = 6.0 * np.array([[math.cos(angle), math.sin(angle)]])
        look(maps, origin, features_from(origin[0], points_m=far, kinds=np.array([1])))
    assert maps.points_m.shape == (2, 4, 2)
    assert maps.points_m[0, :3] == pytest.approx(LANDMARKS[:3], abs=1e-6)
    assert maps.seen[0].tolist() == [3, 3, 3, 1]


def test_resampled_particles_have_the_maps_of_their_parents():
    maps = LandmarkMaps(3, 8)
    poses = np.array([(0.0, 0, 0), (1.0, 0, 0), (2.0, 0, 0)])
    look(maps, poses, features_from(np.zeros(3)))
    before = maps.points_m.copy()
    maps.take(np.array([2, 2, 0]))
    assert (maps.points_m == before[[2, 2, 0]]).all()
    maps.points_m[0] += 1.0
    assert (maps.points_m[1] == before[2]).all()  # brothers share nothing


def test_carried_maps_are_seen_alike():
    maps = LandmarkMaps(1, 8)
    origin, carry = np.zeros((1, 3)), np.array([5.0, -3.0, 2.0])
    look(maps, origin, features_from(origin[0], std_m=0.02))
    maps.carry(carry)
    sightings = Sightings.of(features_from(origin[0]))
    innovations = maps.innovations(carry[None], sightings, np.arange(5)[None])
    assert innovations.error == pytest.approx(np.zeros((1, 5, 2)), abs=1e-9)


def test_innovations_have_the_derivatives_they_claim():
    maps = LandmarkMaps(1, 8)
    pose = np.array([[0.3, -0.2, 0.7]])
    look(maps, np.zeros((1, 3)), features_from(np.zeros(3)))
    sightings, slots = Sightings.of(features_from(pose[0])), np.arange(5)[None]
    by_pose = maps.innovations(pose, sightings, slots).by_pose
    for axis in range(3):
        step = np.zeros((1, 3))
        step[0, axis] = 1e-6
        after = maps.innovations(pose + step, sightings, slots).error
        before = maps.innovations(pose - step, sightings, slots).error
        assert by_pose[..., axis] == pytest.approx((before - after) / 2e-6, abs=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_features_find_their_landmarks_far_off_the_prediction(seed):
    """Half a metre and ten degrees off, among twice as many landmarks as are seen."""
    rng = np.random.default_rng(seed)
    points, kinds = rng.uniform(-5.0, 5.0, (16, 2)), rng.integers(0, 3, 16)
    truth = np.array([0.3, -0.2, 0.5])
    off = np.array([*rng.uniform(-0.35, 0.35, 2), rng.uniform(-0.17, 0.17)])
    seen = features_from(truth, rng, points[:8], kinds[:8], std_m=0.02)
    known = features_from(np.zeros(3), None, points, kinds, std_m=0.02)
    expected = compose(truth, off)
    pairs = correspond(seen, known, expected, np.diag([0.04, 0.04, 0.01]))
    assert len(pairs) >= 6
    assert (pairs.features == pairs.landmarks).mean() > 0.85
    assert pairs.placed_m == pytest.approx(
        Pose2.from_array(expected).apply(seen.points_m[pairs.features])
    )
    assert np.abs(between(truth, expected)).max() > 0.0


def test_nothing_corresponds_to_nothing():
    nothing = features_from(np.zeros(3)).take(np.zeros(0, dtype=np.int64))
    some = features_from(np.zeros(3))
    for one, other in ((nothing, some), (some, nothing), (nothing, nothing)):
        assert len(correspond(one, other, np.zeros(3), np.eye(3) * 0.01)) == 0
