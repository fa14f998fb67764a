# SPDX-License-Identifier: MIT
"""What the simulated LRF sees: exact where it should be, blind where a real one is."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.config import Config, LrfConfig, SimulationConfig
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation import optics as module
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.surfaces import Surfaces
from ins_robot.simulation.world import World

CLEAN = SimulationConfig(
    range_std_floor_m=0.0,
    range_std_per_m3=0.0,
    reflectivity_spread=0.0,
    drop_out=0.0,
    drop_out_grazing=0.0,
    mixed_pixels=0.0,
)
LRF = LrfConfig()
TURN = np.radians(np.arange(360.0))


@pytest.fixture(scope="module")
def hall():
    """8 m x 4 m, walls on cell lines."""
    walls = np.ones((82, 162), dtype=bool)
    walls[1:-1, 1:-1] = False
    return World(walls, 0.05, (-0.05, -0.05))


def eye(world, pose, simulation=CLEAN, lrf=LRF, seed=0):
    body = RobotBody(world, pose, Config(), np.random.default_rng(9))
    return WorldOptics(world, body, lrf, simulation, np.random.default_rng(seed))


def look(optics, bearings=TURN, times=1):
    return [optics.measure(np.zeros(len(bearings)), bearings) for _ in range(times)]


def box_range(x, y, angle, width=8.0, height=4.0):
    c, s = math.cos(angle), math.sin(angle)
    to_x = ((width - x) if c > 0 else -x) / c if abs(c) > 1e-12 else math.inf
    to_y = ((height - y) if s > 0 else -y) / s if abs(s) > 1e-12 else math.inf
    return min(to_x, to_y)


def test_without_noise_ranges_are_those_of_geometry_in_millimetres(hall):
    pose = Pose2(3.017, 1.904, 0.4)
    (reading,) = look(eye(hall, pose))
    wanted = np.array([box_range(pose.x_m, pose.y_m, 0.4 + b) for b in TURN])
    near = wanted < module.RANGE_FADES_M
    np.testing.assert_allclose(reading.range_m[near], wanted[near], atol=0.00051)
    millimetres = reading.range_m[near] * 1000
    np.testing.assert_allclose(millimetres, np.round(millimetres), atol=1e-6)
    assert not reading.error_code[near].any()
    assert np.isnan(reading.range_m[reading.error_code != 0]).all()


def test_the_lrf_may_stand_off_the_centre(hall):
    (reading,) = look(eye(hall, Pose2(3.0, 2.0, math.pi / 2), lrf=LrfConfig(x_m=0.1, y_m=0.05)))
    assert reading.range_m[0] == pytest.approx(4.0 - 2.1, abs=1e-3)
    assert reading.range_m[90] == pytest.approx(3.0 - 0.05, abs=1e-3)


def test_every_beam_is_seen_from_where_the_body_was_then(hall):
    config = replace(Config(), simulation=SimulationConfig(slip_std=0.0, slip_bias_std=0.0))
    body = RobotBody(hall, Pose2(4.0, 2.0), config, np.random.default_rng(0))
    for step in range(100):
        body.advance(0.01 * (step + 1), (0.1, 0.1, 0.1))  # turning on the spot
    optics = WorldOptics(hall, body, LrfConfig(), CLEAN, np.random.default_rng(0))
    stamps = np.linspace(0.5, 1.0, 60)
    reading = optics.measure(stamps, np.zeros(60))
    wanted = [box_range(4.0, 2.0, heading) for heading in body.poses_at(stamps)[:, 2]]
    np.testing.assert_allclose(reading.range_m, wanted, atol=1e-3)


def test_noise_grows_with_the_cube_of_range_and_dim_surfaces_are_noisier(hall):
    dimness = math.sqrt(0.45 / 0.5)  # seen squarely, reflectivity 0.5
    noisy = replace(CLEAN, range_std_floor_m=0.002, range_std_per_m3=0.001)
    for x in (1.0, 5.0):
        readings = look(eye(hall, Pose2(x, 2.0, math.pi), noisy), np.zeros(50), 60)
        ranges = np.concatenate([reading.range_m for reading in readings])
        assert ranges.mean() == pytest.approx(x, abs=0.003)
        wanted = math.hypot(0.002, dimness * 0.001 * x**3)
        assert ranges.std() == pytest.approx(wanted, rel=0.06)


def test_too_near_and_too_far_have_codes(hall):
    walls = hall.is_occupied.copy()
    walls[41, 44] = True
    world = World(walls, 0.05, (-0.05, -0.05))
    (reading,) = look(eye(world, Pose2(1.8, 2.03), lrf=LrfConfig(x_m=0.25)))
    assert reading.error_code[0] == module.CODE_TOO_NEAR
    far = eye(hall, Pose2(1.2, 2.0))  # 6.8 m to the wall ahead
    (reading,) = look(far, np.zeros(1))
    assert (reading.error_code[0], reading.strength[0]) == (module.CODE_NO_RETURN, 0)
    fading = eye(hall, Pose2(2.0, 2.0))  # 6.0 m: half way between fading and gone
    lost = [reading.error_code != 0 for reading in look(fading, np.zeros(50), 20)]
    assert np.mean(lost) == pytest.approx(0.5, abs=0.06)


def test_drop_outs_are_as_many_as_asked_for_and_come_in_runs(hall):
    optics = eye(hall, Pose2(3.0, 2.0), replace(CLEAN, drop_out=0.1))
    near = np.array([box_range(3.0, 2.0, b) for b in TURN]) < 5.5
    lost = np.array([reading.error_code != 0 for reading in look(optics, times=150)])
    assert lost[:, near].mean() == pytest.approx(0.1, abs=0.012)
    again = lost[:, 1:][lost[:, :-1]].mean()  # lost, given that the beam before was
    assert 0.45 < again < 0.75


def test_grazing_beams_are_lost_the_more_the_farther(hall):
    optics = eye(hall, Pose2(0.4, 0.8), replace(CLEAN, drop_out_grazing=1.0))
    bearings = -np.arcsin(0.8 / np.array([1.0, 2.0, 5.0]))  # along the wall below
    valid = np.array([reading.error_code == 0 for reading in look(optics, bearings, 400)])
    shares = valid.mean(axis=0)
    assert shares[0] > 0.97
    assert shares[0] >= shares[1] > shares[2]
    assert shares[2] < 0.9


def test_a_slanted_wall_warns_and_answers_weakly(hall):
    slanted, square = [], []
    for x in np.linspace(0.3, 3.0, 30):
        optics = eye(hall, Pose2(x, 0.3))
        slanted += look(optics, -np.arcsin(0.3 / np.linspace(3.0, 4.0, 10)))
        square += look(optics, np.full(10, -math.pi / 2))
    assert np.mean([reading.is_weak for reading in slanted]) > 0.9
    assert np.mean([reading.is_weak for reading in square]) < 0.2
    strengths = [np.median([r.strength for r in readings]) for readings in (slanted, square)]
    assert strengths[0] < 0.02 * strengths[1]


def test_mixed_pixels_lie_between_the_two_sides_of_an_edge(hall):
    walls = hall.is_occupied.copy()
    walls[30:50, 60:62] = True  # a pillar
    world = World(walls, 0.05, (-0.05, -0.05))
    pose = Pose2(1.5, 2.0)
    (clean,) = look(eye(world, pose))
    mixed = look(eye(world, pose, replace(CLEAN, mixed_pixels=1.0)), times=40)
    sides = np.stack([clean.range_m, np.roll(clean.range_m, 1)])
    low, high = sides.min(axis=0) - 0.002, sides.max(axis=0) + 0.002
    changed = 0
    for reading in mixed:
        ok = np.isfinite(reading.range_m) & np.isfinite(low)
        ok[0] = False  # its neighbour is the last beam of the turn before
        assert ((reading.range_m >= low) & (reading.range_m <= high))[ok].all()
        off = np.abs(reading.range_m - clean.range_m)[ok] > 0.01
        changed += int(off.sum())
    assert 40 <= changed <= 40 * 6
    np.testing.assert_array_equal(look(eye(world, pose, CLEAN))[0].range_m, clean.range_m)


def test_same_seed_same_readings_however_the_turn_is_cut(hall):
    whole = look(eye(hall, Pose2(2.0, 2.0), SimulationConfig(), seed=4))[0]
    same = look(eye(hall, Pose2(2.0, 2.0), SimulationConfig(), seed=4))[0]
    other = look(eye(hall, Pose2(2.0, 2.0), SimulationConfig(), seed=5))[0]
    np.testing.assert_array_equal(whole.range_m, same.range_m)
    np.testing.assert_array_equal(whole.error_code, same.error_code)
    assert not np.array_equal(whole.range_m, other.range_m)
    cut = eye(hall, Pose2(2.0, 2.0))
    parts = [cut.measure(np.zeros(4), TURN[n : n + 4]).range_m for n in range(0, 360, 4)]
    near = np.isfinite(whole.range_m) & (whole.range_m < 5.4)
    np.testing.assert_allclose(
        np.concatenate(parts)[near], look(eye(hall, Pose2(2.0, 2.0)))[0].range_m[near]
    )


def test_no_beams_no_readings(hall):
    reading = eye(hall, Pose2(2.0, 2.0)).measure(np.zeros(0), np.zeros(0))
    assert reading.range_m.shape == (0,)


def test_surfaces_belong_to_the_building_and_face_into_the_room(hall):
    one, other = Surfaces(hall, 1.0), Surfaces(hall, 1.0)
    flat = np.arange(hall.is_occupied.size)
    np.testing.assert_array_equal(one.reflectivity(flat), other.reflectivity(flat))
    share = one.reflectivity(flat)
    assert 0.5 < share.mean() < 0.7
    assert 0.01 < (share < 0.1).mean() < 0.1
    below = np.array([1 * 162 + 80])  # a free cell on the wall below
    for angle, wanted in ((-math.pi / 2, 1.0), (-math.pi / 6, 0.5), (math.pi / 2, 0.0)):
        cos, sin = np.array([math.cos(angle)]), np.array([math.sin(angle)])
        assert one.incidence_cos(below, cos, sin)[0] == pytest.approx(wanted, abs=0.02)


def test_a_slanted_wall_is_no_staircase_to_the_beams():
    rows, cols = np.mgrid[:200, :200]
    world = World(rows < 30 + 0.3 * cols, 0.05)
    normal = np.array([-0.3, 1.0]) / math.hypot(0.3, 1.0)  # x, y
    cells = [(math.ceil(30 + 0.3 * col), col) for col in range(40, 160)]
    flat = np.array([(row + 1) * world.is_occupied.shape[1] + col + 1 for row, col in cells])
    cos, sin = np.full(len(flat), -normal[0]), np.full(len(flat), -normal[1])
    facing = Surfaces(world, 1.0).incidence_cos(flat, cos, sin)
    assert np.degrees(np.arccos(facing)).max() < 12.0


@pytest.mark.parametrize("name", ["rooms", "office", "clutter", "corridor_loop"])
def test_most_beams_in_ordinary_rooms_are_valid_but_not_all(name):
    world = World.builtin(name)
    start = world.start_pose(None, 0.2)
    places = world.metres(np.argwhere(world.reachable(start, 0.2)) + 0.5)
    rng = np.random.default_rng(2)
    valid = []
    for x, y in places[rng.integers(len(places), size=12)]:
        optics = eye(world, Pose2(float(x), float(y)), SimulationConfig())
        clean = look(eye(world, Pose2(float(x), float(y))))[0]
        valid.append((look(optics)[0].error_code == 0)[np.isfinite(clean.range_m)])
    assert 0.80 < np.mean(np.concatenate(valid)) < 0.95
