# SPDX-License-Identifier: MIT
"""Laws of laying all scans on one another at once, when a run has ended."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ray_world import (
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
from ins_robot.estimation import joint_alignment
from ins_robot.estimation.joint_alignment import align_jointly
from ins_robot.estimation.node_map import NodeMap
from ins_robot.estimation.pose_graph import PoseGraph
from ins_robot.estimation.slam import Slam
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.mapping.surfels import surfels_of_scan

BEARING_STD_RAD = math.radians(0.5)
IN_ROOM = np.array(
    [(0.6 * k - 1.0, 0.3 * (-1) ** k, 0.4 * k) for k in range(5)] + [(0.2, 2.0, -1.0)]
)
IN_ROOM[:, 2] = wrap_rad(IN_ROOM[:, 2])
ONCE_AROUND = along_way_points([(0, 0), (10, 0), (10, 10), (0, 10), (0, 0), (6, 0)], 0.5)


def placed(poses, *, true=IN_ROOM, walls=ROOM, std_m=0.003, motions=()):
    """Scans from the `true` poses (K, 3) as nodes at `poses`, linked where a motion is told."""
    nodes, rng = NodeMap(), np.random.default_rng(7)
    for pose, place in zip(poses, true, strict=True):
        scan = scan_at(walls, place, rng, full_turn(), std_m=std_m)
        surfels = surfels_of_scan(scan, BEARING_STD_RAD, 12.0)
        node = nodes.add(np.asarray(pose, float), scan, surfels, 0.5 * len(nodes))
        if node:
            step = motion_between(poses[node - 1], pose, std=(0.2, 0.2, 0.1))
            nodes.link_motion(node - 1, node, step, is_matched=True)
    return nodes


def errors(nodes, true=IN_ROOM):
    off = nodes.graph.poses - true
    return np.hypot(off[:, 0], off[:, 1]), np.abs(wrap_rad(off[:, 2]))


def around(seed, **options):
    """A drive around a block, a bit further than once."""
    config = SlamConfig(**options)
    slam = Slam(config, MapConfig(), Pose2(), np.random.default_rng(seed))
    drive(slam, RING, ONCE_AROUND - ONCE_AROUND[0], seed, std_m=0.02)
    return slam


def test_what_the_way_handed_on_is_taken_back():
    before, after = [], []
    for seed in range(4):
        slam = around(seed)
        before.append(position_errors_m(slam.node_poses, ONCE_AROUND))
        slam.settle()
        after.append(position_errors_m(slam.node_poses, ONCE_AROUND))
    rms_before, rms_after = (math.sqrt(np.square(e).mean()) for e in (before, after))
    assert rms_after < 0.8 * rms_before
    assert rms_after < 0.03


def test_scans_where_they_were_taken_stay():
    nodes = placed(IN_ROOM)
    assert align_jointly(nodes)
    off_m, off_rad = errors(nodes)
    assert off_m.max() < 0.003
    assert off_rad.max() < math.radians(0.15)


@pytest.mark.parametrize("seed", range(3))
def test_scans_beside_their_places_go_there(seed):
    rng = np.random.default_rng(seed)
    beside = IN_ROOM + rng.normal(0.0, (0.04, 0.04, 0.015), IN_ROOM.shape)
    beside[0] = IN_ROOM[0]
    nodes = placed(beside)
    before_m, before_rad = errors(nodes)
    assert align_jointly(nodes)
    off_m, off_rad = errors(nodes)
    assert np.array_equal(nodes.graph.poses[0], IN_ROOM[0])  # the map's frame is its
    assert off_m.mean() < 0.25 * before_m.mean()
    assert off_rad.mean() < 0.25 * before_rad.mean()


def test_it_is_equivariant_under_rigid_motion():
    """A map carried elsewhere settles alike, but for its cells' lattice."""
    rng = np.random.default_rng(3)
    beside = IN_ROOM + rng.normal(0.0, (0.03, 0.03, 0.01), IN_ROOM.shape)
    carried = np.array([12.3, -4.56, 1.1])
    here, there = placed(beside), placed(compose(carried, beside))
    assert align_jointly(here)
    assert align_jointly(there)
    off = there.graph.poses - compose(carried, here.graph.poses)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.006
    assert np.abs(wrap_rad(off[:, 2])).max() < math.radians(0.3)


@pytest.mark.parametrize("apart_m", [7.5, 40.0])  # beside one another, and out of reach
def test_scans_that_see_nothing_alike_stay(apart_m):
    """Two rooms that no scan links: not a pose changes by a bit."""
    apart = np.array([(0.0, 0.0, 0.0), (apart_m, 0.0, 0.0)])
    aside = np.array([apart_m, 0.0, apart_m, 0.0])
    walls = np.concatenate([ROOM, ROOM + aside])
    nodes = placed(apart, true=apart, walls=walls)
    graph = nodes.graph
    assert not align_jointly(nodes)
    assert nodes.graph is graph
    assert np.array_equal(nodes.graph.poses, apart)


def test_a_round_that_tears_the_map_is_taken_back(monkeypatch):
    rng = np.random.default_rng(5)
    beside = IN_ROOM + rng.normal(0.0, (0.03, 0.03, 0.01), IN_ROOM.shape)
    nodes = placed(beside)
    monkeypatch.setattr(joint_alignment, "FIT_KEPT_MIN", 100.0)
    assert not align_jointly(nodes)
    assert np.array_equal(nodes.graph.poses, beside)
    assert nodes.graph.edge_count == len(beside) - 1


def test_equations_without_an_answer_leave_the_map(monkeypatch):
    nodes = placed(IN_ROOM)
    graph = nodes.graph

    def unsolved(self):
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr(PoseGraph, "relax", unsolved)
    assert not align_jointly(nodes)
    assert nodes.graph is graph


def test_motions_and_directions_stay_in_the_graph():
    graph = PoseGraph()
    for pose in IN_ROOM:
        graph.add_node(pose)
    told = np.diag([3.0, 4.0, 5.0])
    graph.add_edge(0, 1, np.array([1.0, 2.0, 0.5]), told, is_motion=True)
    graph.add_edge(1, 3, np.zeros(3), 1e6 * told)
    graph.add_edge(0, 4, np.zeros(3), 1e6 * told, is_closure=True)
    direction = graph.add_direction(0.3)
    for node in (1, 2):
        graph.add_sight(node, direction, wrap_rad(IN_ROOM[node, 2] - 0.3) + 0.1, 0.01)
    other = graph.rematched(np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    assert other.edge_count == 1
    other.relax()
    first, second = between(other.poses[0], other.poses[1]), other.poses[1:3, 2]
    np.testing.assert_allclose(first[:2], [1.0, 2.0], atol=0.05)  # where the motion led
    turned = wrap_rad(second - IN_ROOM[1:3, 2] - 0.1)
    assert abs(wrap_rad(turned[0] - turned[1])) < 1e-3  # both see the direction alike


def test_the_robot_goes_with_the_map():
    slam = around(1)
    anchor, moves = slam.anchors[-1], slam.map_moves
    slam.settle()
    expected = slam.nodes[anchor.node_id].pose @ anchor.node_from_base
    assert slam.map_moves == moves + 1
    assert slam.pose.as_array() == pytest.approx(expected.as_array(), abs=1e-9)


@pytest.mark.parametrize("option", [{"joint_alignment": False}, {"estimator": "similarity"}])
def test_whoever_does_not_want_it_keeps_the_map_to_the_bit(option):
    slam = around(2, **option)
    before, grid = slam.node_poses, slam.grid.log_odds.copy()
    slam.settle()
    assert np.array_equal(slam.node_poses, before)
    assert np.array_equal(slam.grid.log_odds, grid)


def test_the_same_seed_settles_to_the_same_bytes():
    one, other = around(3), around(3)
    one.settle()
    other.settle()
    assert one.node_poses.tobytes() == other.node_poses.tobytes()


def test_a_map_of_nothing_and_of_one_scan_settle():
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(0))
    slam.settle()
    drive(slam, ROOM, IN_ROOM[:1], 0)
    slam.settle()
    assert slam.node_poses.shape == (1, 3)
