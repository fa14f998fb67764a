# SPDX-License-Identifier: MIT
"""Laws of the directions that walls run in: what they say, and what they may move."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from ray_world import ROOM, full_turn, scan_at

from ins_robot.estimation.pose_graph import PoseGraph
from ins_robot.estimation.wall_directions import (
    SHARP_STD_RAD,
    SHARP_WITHIN_M,
    WallDirections,
    wall_direction,
    wrap_quarter_rad,
)
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.mapping.surfels import surfels_of_scan

TURN_STD_RAD = math.radians(0.1)
SLIGHT = np.diag([1e4, 1e4, 1.0 / TURN_STD_RAD**2])


def surfels_at(walls, pose, seed=1):
    scan = scan_at(walls, pose, np.random.default_rng(seed), full_turn(), std_m=0.005)
    return surfels_of_scan(scan, math.radians(0.5), 12.0)


def ring_of(corners, radius_m=3.0):
    turns = 2.0 * math.pi * np.arange(corners + 1) / corners
    at = radius_m * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    return np.concatenate([at[:-1], at[1:]], axis=1)


@settings(max_examples=30, deadline=None)
@given(st.integers(-180, 179), st.integers(0, 1000))
def test_a_room_shows_its_walls_whichever_way_the_robot_stands(heading_deg, seed):
    heading = math.radians(heading_deg)
    seen = wall_direction(surfels_at(ROOM, (0.4, 0.3, heading), seed))
    assume(seen is not None)
    assert seen.std_rad < math.radians(1.0)
    assert abs(float(wrap_quarter_rad(seen.heading_rad + heading))) < 3.0 * seen.std_rad


def test_hardly_a_scan_of_a_room_is_too_vague():
    """Noise makes one in 200 so."""
    scans = [surfels_at(ROOM, (0.4, 0.3, math.radians(3 * k)), seed=k) for k in range(120)]
    assert sum(wall_direction(scan) is None for scan in scans) <= 3


def test_where_no_direction_stands_out_there_is_none():
    assert wall_direction(surfels_at(ring_of(60), (0.0, 0.0, 0.0))) is None
    legs = np.concatenate([ring_of(6, 0.03) + np.tile([x, 1.0], 2) for x in (-1.0, 0.0, 1.0)])
    assert wall_direction(surfels_at(legs, (0.0, 0.0, 0.0))) is None


def test_a_wall_with_a_bend_is_too_vague():
    """Two directions three degrees apart: the mean of both is neither."""
    bent = np.array([(-3.0, 1.5, 0.0, 1.5), (0.0, 1.5, 3.0, 1.5 + 3.0 * math.tan(0.05))])
    straight = wall_direction(surfels_at(bent[:1], (0.0, 0.0, 0.0)))
    mixed = wall_direction(surfels_at(bent, (0.0, 0.0, 0.0)))
    assert straight is not None
    assert straight.std_rad < SHARP_STD_RAD
    assert mixed is None or mixed.std_rad > SHARP_STD_RAD


def chain_of(headings_off, seen_off=0.0, count=60, sees=True):
    """A straight chain whose headings drift, in a building whose walls the nodes see."""
    graph, directions = PoseGraph(), WallDirections()
    scan = surfels_at(ROOM, (0.4, 0.3, 0.0))
    step = np.array([0.5, 0.0, headings_off])
    graph.add_node(np.zeros(3))
    for k in range(1, count):
        graph.add_node(compose(graph.poses[k - 1], step))
        graph.add_edge(k - 1, k, step, SLIGHT)
        turned = seen_off if k >= count // 2 else 0.0
        if sees and directions.see(graph, k, scan.at(Pose2(0.0, 0.0, turned)), 0.5 * k):
            graph.relax()
    return graph


def test_directions_undo_the_drift_of_a_chain_without_a_loop():
    blind = chain_of(math.radians(0.1), sees=False)
    assert np.abs(blind.poses[:, 2]).max() > math.radians(5.5)
    assert np.abs(blind.poses[:, 1]).max() > 1.4
    graph = chain_of(math.radians(0.1))
    assert np.abs(graph.poses[:, 2]).max() < math.radians(2.0)
    assert np.abs(graph.poses[:, 1]).max() < 0.4
    assert graph.poses[-1, 0] == pytest.approx(29.5, abs=0.05)


def test_a_wing_that_is_off_square_keeps_its_own_heading():
    """Edges say straight on, walls are seen 12 degrees off: a direction of its own."""
    graph = chain_of(0.0, seen_off=math.radians(12.0))
    graph.relax()
    assert len(graph.directions_rad) == 2
    assert np.abs(graph.poses[:, 2]).max() < math.radians(0.05)


def test_a_vague_direction_counts_only_far_from_sharp_ones():
    bent = np.array([(-3.0, 1.5, 0.0, 1.5), (0.0, 1.5, 3.0, 1.5 + 3.0 * math.tan(0.05))])
    vague, sharp = surfels_at(bent, (0.0, 0.0, 0.0)), surfels_at(ROOM, (0.4, 0.3, 0.0))
    seen = wall_direction(vague)
    assert seen.std_rad > SHARP_STD_RAD
    seen_off = vague.at(Pose2(0.0, 0.0, math.radians(3.0) - seen.heading_rad))
    for way_m, counts in ((SHARP_WITHIN_M - 0.1, False), (SHARP_WITHIN_M + 0.1, True)):
        graph, directions = PoseGraph(), WallDirections()
        graph.add_node(np.zeros(3))
        assert not directions.see(graph, 0, sharp, 0.0)
        assert directions.see(graph, 0, seen_off, way_m) is counts


@settings(max_examples=20, deadline=None)
@given(st.floats(-math.pi, math.pi, exclude_max=True), st.integers(0, 100))
def test_relaxing_with_directions_is_equivariant(turn, seed):
    """The whole graph turned gives the relaxed graph turned alike."""
    rng = np.random.default_rng(seed)
    steps = np.stack([np.full(12, 0.5), np.zeros(12), rng.normal(0.0, 0.02, 12)], axis=-1)
    ends = []
    for carried in (np.zeros(3), np.array([3.0, -2.0, turn])):
        graph = PoseGraph()
        pose = carried
        graph.add_node(pose)
        direction = graph.add_direction(float(carried[2]))
        for k, step in enumerate(steps, start=1):
            pose = compose(pose, step)
            graph.add_node(pose)
            graph.add_edge(k - 1, k, step, SLIGHT)
            graph.add_sight(k, direction, 0.0, math.radians(0.3))
        graph.relax()
        off = between(carried, graph.poses)
        off[:, 2] = wrap_rad(off[:, 2])
        ends.append(off)
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


def test_what_all_agrees_is_left_untouched():
    graph = PoseGraph()
    direction = graph.add_direction(0.3)
    for k in range(5):
        graph.add_node(np.array([float(k), 0.0, 0.0]))
        graph.add_sight(k, direction, -0.3, 0.01)
        if k:
            graph.add_edge(k - 1, k, np.array([1.0, 0.0, 0.0]), SLIGHT)
    before = graph.poses.tobytes()
    assert not graph.relax().any()
    assert graph.poses.tobytes() == before
