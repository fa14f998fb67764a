# SPDX-License-Identifier: MIT
"""Laws of matching, weighing, resampling, relaxing and rendering."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.monte_carlo import systematic_resample
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_world import (
    CORRIDOR,
    RING,
    ROOM,
    along_way_points,
    box,
    drive,
    full_turn,
    motion_between,
    scan_at,
)

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.node_map import NodeMap
from ins_robot.estimation.particle_filter import ParticleFilter
from ins_robot.estimation.pose_graph import PoseGraph
from ins_robot.estimation.rendered_map import STRIP_NODES, RenderedMap
from ins_robot.estimation.resampling import (
    effective_sample_size,
    normalise,
    resample_low_variance,
)
from ins_robot.estimation.scan_matching import align, log_likelihoods, search
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.surfels import surfels_of_scan

BEARING_STD_RAD = math.radians(0.5)
WEAK = np.diag([1.0, 1.0, 1.0])


def surfels_at(walls, pose, seed, **more):
    rng = np.random.default_rng(seed)
    scan = scan_at(walls, pose, rng, more.pop("bearings", full_turn()), **more)
    return surfels_of_scan(scan, BEARING_STD_RAD, 12.0)


def field_at(walls, pose, seed, carried=(0.0, 0.0, 0.0)):
    seen = surfels_at(walls, pose, seed).seen_by(0)
    return LikelihoodField(seen.at(Pose2.from_array(compose(carried, pose))))


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(
        st.floats(-30, 30), st.floats(-30, 30), st.floats(-math.pi, math.pi, exclude_max=True)
    )
)
def test_matching_is_equivariant_under_rigid_motion(carried):
    """A map carried elsewhere finds the scan carried alike, but for its cells' lattice."""
    scan = surfels_at(ROOM, (0.4, 0.3, 0.5), seed=2)
    start = np.array([0.3, 0.35, 0.46])
    here = align(field_at(ROOM, np.zeros(3), 1), scan, start[None], start, WEAK)
    carried = np.array(carried)
    away = compose(carried, start)
    there = align(field_at(ROOM, np.zeros(3), 1, carried), scan, away[None], away, WEAK)
    off = between(compose(carried, here.pose), there.pose)
    assert np.hypot(off[0], off[1]) < 0.01
    assert abs(off[2]) < math.radians(0.3)


def test_search_finds_what_descent_could_not():
    truth = np.array([0.9, -0.6, 1.0])
    scan = surfels_at(ROOM, truth, seed=4)
    field = field_at(ROOM, np.zeros(3), 3)
    found = search(field, scan, truth + np.array([0.7, -0.6, 0.3]), 1.0, math.radians(25.0))
    assert np.hypot(*(found.pose - truth)[:2]) < 0.08
    assert abs(found.pose[2] - truth[2]) < math.radians(1.5)
    assert found.value > 1.15 * found.rival_value


def test_what_comes_into_view_draws_no_pose_back():
    """Walls come out from behind door posts on the way; on average they move nothing."""
    posts = [(x, y, x + 0.1, y + 2.5) for x in range(-8, 9, 2) for y in (-3.0, 0.5)]
    walls = np.array(
        [*box(-9.0, -3.0, 9.0, 3.0), *(wall for post in posts for wall in box(*post))]
    )
    off_m = []
    for k in range(120):
        before, now = np.array([-6.0 + 0.1 * k, 0.0, 0.0]), np.array([-5.5 + 0.1 * k, 0.0, 0.0])
        seen = surfels_at(walls, before, k, std_m=0.003).seen_by(0)
        field = LikelihoodField(seen.at(Pose2.from_array(before)))
        scan = surfels_at(walls, now, k + 1000, std_m=0.003)
        off_m.append(float(align(field, scan, now[None], now, WEAK).pose[0] - now[0]))
    assert abs(np.mean(off_m)) < 0.00025


def test_a_corridor_says_nothing_along_its_axis():
    field = field_at(CORRIDOR, np.zeros(3), 5)
    scan = surfels_at(CORRIDOR, (0.3, 0.05, 0.02), seed=6)
    prior = np.array([0.1, 0.0, 0.0])
    match = align(field, scan, prior[None], prior, np.diag([400.0, 400.0, 2500.0]))
    along, across = match.information[0, 0], match.information[1, 1]
    assert along < 0.02 * across
    assert match.pose[0] == pytest.approx(0.1, abs=0.05)  # the prior decides
    assert match.pose[1] == pytest.approx(0.05, abs=0.01)  # the scan decides


@given(st.lists(st.floats(-50, 5), min_size=2, max_size=40), st.floats(-1e3, 1e3))
def test_weights_do_not_change_with_a_constant(log_likelihoods_, constant):
    values = np.array(log_likelihoods_)
    assert normalise(values + constant) == pytest.approx(normalise(values), abs=1e-9)


@given(st.lists(st.floats(0.01, 1.0), min_size=2, max_size=30), st.integers(0, 1000))
def test_resampled_counts_are_floor_or_ceiling_of_their_mean(raw, seed):
    weights = np.array(raw) / np.sum(raw)
    picked = resample_low_variance(weights, np.random.default_rng(seed))
    counts = np.bincount(picked, minlength=len(weights))
    assert counts.sum() == len(weights)
    assert (np.abs(counts - len(weights) * weights) < 1.0 + 1e-9).all()


def test_resampling_is_unbiased_and_filterpy_agrees():
    weights = np.array([0.45, 0.27, 0.18, 0.07, 0.03])
    rng = np.random.default_rng(7)
    rounds = 4000
    ours = np.zeros(5)
    for _ in range(rounds):
        ours += np.bincount(resample_low_variance(weights, rng), minlength=5)
    assert ours / rounds == pytest.approx(5 * weights, abs=0.03)
    np.random.seed(8)  # noqa: NPY002 - filterpy draws from the global generator
    theirs = np.zeros(5)
    for _ in range(rounds):
        theirs += np.bincount(systematic_resample(weights), minlength=5)
    assert ours / rounds == pytest.approx(theirs / rounds, abs=0.05)


def test_effective_sample_size_has_its_two_ends():
    assert effective_sample_size(np.full(50, 0.02)) == pytest.approx(50.0)
    assert effective_sample_size(np.eye(50)[3]) == pytest.approx(1.0)


def test_weighed_particles_are_the_bayesian_product_of_motion_and_scan():
    """Where everything is Gaussian the particles' moments are those of the textbook."""
    rng = np.random.default_rng(9)
    particles = ParticleFilter(20000, np.zeros(3), rng)
    particles.predict(motion_between((0, 0, 0), (1.0, 0.2, 0.3), std=(0.1, 0.05, 0.03)))
    prior, covariance = particles.prior()
    information = np.diag([400.0, 900.0, 2500.0])
    mode = prior + np.array([0.08, -0.03, 0.02])

    def log_likelihood(poses):
        off = poses - mode
        return -0.5 * np.einsum("pi,ij,pj->p", off, information, off)

    particles.weigh(_gaussian_match(mode, information), log_likelihood)
    posterior = np.linalg.inv(np.linalg.inv(covariance) + information)
    expected = posterior @ (np.linalg.inv(covariance) @ prior + information @ mode)
    assert particles.mean() == pytest.approx(expected, abs=0.002)
    assert particles.covariance() == pytest.approx(posterior, rel=0.08, abs=2e-5)


def _gaussian_match(mode, information):
    field = field_at(ROOM, np.zeros(3), 1)
    match = align(field, surfels_at(ROOM, (0, 0, 0), 2), np.zeros((1, 3)), np.zeros(3), WEAK)
    names = ("inlier_share", "inliers", "cost", "is_inlier")
    kept = {name: getattr(match, name) for name in names}
    return type(match)(
        pose=mode, information=information, gradient=np.zeros(3), by_source={}, **kept
    )


def test_likelihood_of_all_particles_at_once_is_that_of_each():
    field = field_at(ROOM, np.zeros(3), 1)
    scan = surfels_at(ROOM, (0.1, 0.1, 0.1), 2)
    poses = np.random.default_rng(3).normal(0.1, 0.05, (40, 3))
    together = log_likelihoods(field, scan, poses)
    alone = [log_likelihoods(field, scan, pose[None])[0] for pose in poses]
    assert together == pytest.approx(np.array(alone), rel=1e-12)
    truth = log_likelihoods(field, scan, np.array([[0.1, 0.1, 0.1]]))[0]
    assert truth > np.quantile(together, 0.9)


def ring_graph(rng, noise):
    """A graph around a circle whose odometry is noisy and whose closure is exact."""
    turns = np.linspace(0.0, 2 * math.pi, 21)[:-1]
    truth = np.stack([5 * np.sin(turns), 5 - 5 * np.cos(turns), turns], axis=-1)
    truth[:, 2] = wrap_rad(truth[:, 2])
    graph = PoseGraph()
    pose = truth[0]
    graph.add_node(pose)
    for k in range(1, len(truth)):
        step = between(truth[k - 1], truth[k]) + rng.normal(0.0, noise, 3)
        pose = compose(pose, step)
        graph.add_node(pose)
        graph.add_edge(k - 1, k, step, np.diag([100.0, 100.0, 1000.0]))
    return graph, truth


def test_a_consistent_graph_is_left_untouched():
    graph, _ = ring_graph(np.random.default_rng(1), 0.02)
    poses = graph.poses
    graph.add_edge(19, 0, between(poses[19], poses[0]), np.diag([1e4, 1e4, 1e5]), True)
    before = poses.tobytes()
    moved = graph.relax()
    assert graph.poses.tobytes() == before
    assert not moved.any()


def test_relaxation_spreads_the_error_of_a_loop():
    graph, truth = ring_graph(np.random.default_rng(2), 0.02)
    before = np.hypot(*(graph.poses - truth)[:, :2].T).max()
    graph.add_edge(19, 0, between(truth[19], truth[0]), np.diag([1e4, 1e4, 1e5]), True)
    graph.relax()
    end = between(graph.poses[19], graph.poses[0]) - between(truth[19], truth[0])
    assert np.abs(end).max() < 0.01
    assert np.hypot(*(graph.poses - truth)[:, :2].T).max() < 0.6 * before
    assert (graph.poses[0] == truth[0]).all()


def test_relaxation_does_not_depend_on_where_the_map_lies():
    rng = np.random.default_rng(3)
    graph, truth = ring_graph(rng, 0.02)
    away, _ = ring_graph(np.random.default_rng(3), 0.02)
    carried = np.array([20.0, -7.0, 2.0])
    away.poses[:] = compose(carried, away.poses)
    for g in (graph, away):
        g.add_edge(19, 0, between(truth[19], truth[0]), np.diag([1e4, 1e4, 1e5]), True)
        g.relax()
    assert compose(carried, graph.poses) == pytest.approx(away.poses, abs=1e-4)


BASE_FROM_LRF = Pose2(0.1, 0.0, 0.2)
BUILDING_SIDE_M = 0.6


def rendered_nodes(count, **more):
    """That many nodes in a room, their map, and the grid it is drawn to."""
    rng = np.random.default_rng(4)
    nodes, rendered = NodeMap(), RenderedMap(MapConfig(), BASE_FROM_LRF, 3.0)
    for k in range(count):
        pose = np.array([BUILDING_SIDE_M * (k % 3), 0.1 * (k % 5), 0.3 * k])
        pose[2] = wrap_rad(float(pose[2]))
        scan = scan_at(ROOM, pose, rng, full_turn(), **more)
        nodes.add(pose, scan, surfels_of_scan(scan, BEARING_STD_RAD, 12.0), 0.0)
        if k % 4 == 0:
            assert rendered.grid(nodes).is_occupied.any()
    return nodes, rendered


def drawn_at_once(nodes):
    direct = OccupancyGrid(MapConfig().resolution_m, MapConfig())
    for scan, pose in zip(nodes.scans, nodes.graph.poses, strict=True):
        direct.integrate(scan, Pose2.from_array(pose) @ BASE_FROM_LRF, 3.0)
    return direct


def is_same(one, other):
    assert one.origin_m == other.origin_m
    assert (one.log_odds == other.log_odds).all()
    assert (one.is_quiet == other.is_quiet).all()
    assert np.array_equal(
        np.sort(one.walls().data, axis=0), np.sort(other.walls().data, axis=0)
    )
    return True


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_rendering_commutes_with_moving_nodes(missing):
    """To the bit: all of them, one in the middle, and while it goes on."""
    nodes, rendered = rendered_nodes(3 * STRIP_NODES + 5, missing=missing)
    nodes.graph.poses[:] = compose([0.7, -0.4, 0.6], nodes.graph.poses)
    assert is_same(rendered.grid(nodes), drawn_at_once(nodes))
    for moved in (slice(STRIP_NODES + 3, STRIP_NODES + 4), slice(5, 60)):
        nodes.graph.poses[moved] = compose([0.1, 0.3, -0.2], nodes.graph.poses[moved])
        assert is_same(rendered.grid(nodes), drawn_at_once(nodes))
    scan = nodes.scans[0]
    nodes.add(np.zeros(3), scan, surfels_of_scan(scan, BEARING_STD_RAD, 12.0), 0.0)
    assert is_same(rendered.grid(nodes), drawn_at_once(nodes))


def test_only_the_strip_of_a_node_that_moved_is_drawn_again(monkeypatch):
    nodes, rendered = rendered_nodes(3 * STRIP_NODES)
    rendered.grid(nodes)
    drawn = []
    one = OccupancyGrid.footprint_of
    monkeypatch.setattr(
        OccupancyGrid, "footprint_of", lambda *args: drawn.append(1) or one(*args)
    )
    nodes.graph.poses[STRIP_NODES] += [0.1, 0.0, 0.0]
    rendered.grid(nodes)
    assert len(drawn) == STRIP_NODES
    rendered.grid(nodes)
    assert len(drawn) == STRIP_NODES


def run(seed):
    path = along_way_points([(0, 0), (10, 0), (10, 10)], 1.2)
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(seed))
    estimates = drive(slam, RING, path, seed=11, missing=0.2)
    return estimates.tobytes() + slam.node_poses.tobytes() + slam.grid.log_odds.tobytes()


def test_same_seed_same_bytes():
    assert run(0) == run(0)
    assert run(0) != run(1)


def test_what_is_known_makes_no_nodes_however_often_it_is_passed():
    lap = along_way_points([(0, 0), (2, 0), (2, 2), (0, 2), (0, 0)], 0.2)
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(0))
    drive(slam, ROOM, np.vstack([lap] * 8), seed=0, keep=Keep.NEW)
    laps = np.array([node.stamp_s for node in slam.nodes]) // len(lap)
    assert (laps == 0).sum() > 10
    assert (laps >= 4).sum() < (laps == 0).sum() / 3


def test_what_has_changed_makes_nodes_again():
    lap = along_way_points([(0, 0), (1.2, 0), (0, 0), (1.2, 0), (0, 0)], 0.2)
    again = np.vstack([lap[-1:], lap])
    slam = Slam(SlamConfig(), MapConfig(), Pose2(), np.random.default_rng(0))
    drive(slam, ROOM, lap, seed=1, keep=Keep.NEW)
    drive(slam, ROOM, again, seed=2, keep=Keep.NEW)
    known = len(slam.nodes)
    drive(slam, ROOM, again, seed=3, keep=Keep.NEW)
    assert len(slam.nodes) <= known + 1
    before = len(slam.nodes)
    furnished = np.vstack([ROOM, box(-0.8, 1.2, 1.2, 2.0)])
    drive(slam, furnished, again, seed=4, keep=Keep.NEW)
    assert len(slam.nodes) > before
