# SPDX-License-Identifier: MIT
"""Laws of features: they are where the world's corners are, from wherever they are seen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ray_world import RING, ROOM, box, full_turn, scan_at

from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.features import FeatureKind, Features, features_of_scan

BEARING_STD_RAD = math.radians(0.5)
REACH_M = 8.0
STANDS = np.array(
    [(0, 0, 0), (0.5, 2, 1), (3, 2, 2), (-2.5, 1, 0), (3.2, -1, -2.5), (0.6, 0, 3)]
)


def seen_from(walls, pose, seed=0, bearings=None, **more):
    rng = np.random.default_rng(seed)
    scan = scan_at(walls, pose, rng, full_turn() if bearings is None else bearings, **more)
    features = features_of_scan(scan, BEARING_STD_RAD, REACH_M)
    return features.at(Pose2.from_array(np.asarray(pose, float)))


def vertices(walls):
    return np.unique(np.concatenate([walls[:, :2], walls[:, 2:]]), axis=0)


def nearest(features: Features, points_m):
    """Chi-squared (F,) of each feature against the nearest of the points (V, 2), and which."""
    off = features.points_m[:, None] - points_m
    which = (off**2).sum(axis=-1).argmin(axis=1)
    miss = off[np.arange(len(features)), which]
    chi2 = np.einsum("fi,fij,fj->f", miss, np.linalg.inv(features.covariances), miss)
    return chi2, which


@pytest.mark.parametrize(
    ("missing", "share_off"), [(0.0, 0.03), (0.5, 0.06)], ids=["all beams", "half lost"]
)
@pytest.mark.parametrize("walls", [ROOM, RING], ids=["room", "ring"])
def test_features_are_corners_of_the_world_within_their_covariance(walls, missing, share_off):
    """From random places; 9.2 is the 99 % of a chi-squared of two.

    Where every second beam is lost the last reading before a corner may be on either wall.
    """
    rng = np.random.default_rng(1)
    chi2 = []
    for seed in range(120):
        pose = (*rng.uniform(-0.8, 0.8, 2), rng.uniform(-3, 3))
        features = seen_from(walls, pose, seed, missing=missing)
        chi2 += nearest(features, vertices(walls))[0].tolist()
    assert len(chi2) > 60
    assert np.mean(np.array(chi2) > 9.2) < share_off
    assert np.median(chi2) > 0.1  # and the covariance does not promise too little either


def test_moved_robots_see_the_same_features_in_the_same_places():
    scans = [seen_from(ROOM, pose, seed) for seed, pose in enumerate(STANDS)]
    shared = 0
    for i, one in enumerate(scans):
        for other in scans[i + 1 :]:
            gaps = np.hypot(*(one.points_m[:, None] - other.points_m).transpose(2, 0, 1))
            a, b = np.nonzero((gaps < 0.3) & (one.kinds[:, None] == other.kinds))
            shared += len(a)
            miss = one.points_m[a] - other.points_m[b]
            spread = one.covariances[a] + other.covariances[b]
            chi2 = np.einsum("fi,fij,fj->f", miss, np.linalg.inv(spread), miss)
            assert (chi2 < 13.8).all()  # 99.9 %
            turn = wrap_rad(one.headings_rad[a] - other.headings_rad[b])
            is_same_side = np.abs(turn) < math.radians(45.0)  # ends have two
            assert (is_same_side | (one.kinds[a] == FeatureKind.WALL_END)).all()
            spread = one.heading_vars[a] + other.heading_vars[b]
            assert (turn**2 < 13.8 * spread)[is_same_side].all()
    assert shared > 30


def test_most_of_what_a_room_has_is_found():
    features = seen_from(ROOM, (0.0, 0.0, 0.0))
    chi2, which = nearest(features, vertices(ROOM))
    assert len(set(which[chi2 < 9.2].tolist())) >= 8  # of 8 that can be seen
    assert len(which) == len(set(which.tolist()))  # none twice


def test_features_turn_with_the_robot():
    """The same world seen with another heading; beams fall on other points of the walls."""
    here = seen_from(ROOM, (0.2, 0.1, 0.0), std_m=1e-4)
    turned = seen_from(ROOM, (0.2, 0.1, math.radians(37.0)), std_m=1e-4)
    assert len(here) == len(turned)
    order, other = (np.lexsort(f.points_m.round(1).T) for f in (here, turned))
    assert here.points_m[order] == pytest.approx(turned.points_m[other], abs=0.06)
    assert (here.kinds[order] == turned.kinds[other]).all()


def test_the_seam_of_the_turn_hides_nothing():
    """A corner straight behind, where the bearings begin and end."""
    walls = np.array(box(-2.0, -2.0, 2.0, 2.0))
    features = seen_from(walls, (0.0, 0.0, math.radians(45.0)))
    assert len(features) == 4
    assert (features.kinds == FeatureKind.INNER_CORNER).all()
    inward = np.arctan2(-features.points_m[:, 1], -features.points_m[:, 0])
    assert wrap_rad(features.headings_rad - inward) == pytest.approx(np.zeros(4), abs=0.04)
    assert np.abs(features.points_m) == pytest.approx(2.0, abs=0.03)


def test_kinds_are_told_apart():
    walls = np.array([*box(-4.0, -4.0, 4.0, 4.0), *box(1.0, 0.0, 1.1, 0.1), (0, -2, 1.5, -2)])
    features = seen_from(walls, (0.0, 0.5, 0.3))
    kinds = FeatureKind

    def at(x_m, y_m):
        near = np.hypot(*(features.points_m - (x_m, y_m)).T) < 0.1
        return [kinds(kind) for kind in features.kinds[near]]

    assert at(1.05, 0.05) == [kinds.OBJECT]
    assert at(1.5, -2.0) == [kinds.WALL_END]
    assert at(-4.0, 4.0) == [kinds.INNER_CORNER]


def test_a_bare_wall_and_silence_have_no_features():
    corridor = np.array([(-50.0, -1.0, 50.0, -1.0), (-50.0, 1.0, 50.0, 1.0)])
    assert len(seen_from(corridor, (0.0, 0.0, 0.3))) == 0
    assert len(seen_from(corridor, (0.0, 0.0, 0.0), missing=1.1)) == 0
    assert len(seen_from(corridor, (0.0, 0.0, 0.0), bearings=np.zeros(1))) == 0
