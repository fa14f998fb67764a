# SPDX-License-Identifier: MIT
"""The simulated body: wheels, slip, contacts, faults; the truth it keeps of itself."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.config import Config, SimulationConfig
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.errors import InputError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.body_faults import BodyFault
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.world import World

IDEAL = replace(
    Config(), simulation=SimulationConfig(slip_std=0.0, slip_bias_std=0.0, motor_lag_s=0.001)
)
KINEMATICS = OmniKinematics(IDEAL.wheels)
FULL_RADPS = IDEAL.wheels.free_speed_radps
COUNTS_PER_RAD = 4096 / (2 * math.pi)


@pytest.fixture(scope="module")
def hall():
    walls = np.zeros((100, 140), dtype=bool)  # 7 m x 5 m
    walls[[0, -1]] = walls[:, [0, -1]] = True
    return World(walls, 0.05)


def body(world, x=2.0, y=2.5, heading=0.0, config=IDEAL, seed=0):
    return RobotBody(world, Pose2(x, y, heading), config, np.random.default_rng(seed))


def duties(vx, vy=0.0, yaw_rate=0.0):
    a, b, c = (w / FULL_RADPS for w in KINEMATICS.wheel_speeds(vx, vy, yaw_rate))
    return a, b, c


def drive(robot, seconds, *velocity):
    until = robot.now_s + seconds
    while until - robot.now_s > 1e-6:
        robot.advance(robot.now_s + 0.01, duties(*velocity))


@pytest.mark.parametrize("velocity", [(0.3, 0.0, 0.0), (0.0, -0.2, 0.0), (0.2, 0.1, 0.5)])
def test_without_slip_the_body_follows_its_kinematics(hall, velocity):
    robot = body(hall, heading=0.7)
    drive(robot, 3.0, *velocity)
    vx, vy, rate = velocity
    heading = np.linspace(0.0, 3.0 * rate, 30001) + 0.7
    wanted_x = 2.0 + 3.0 * np.mean(np.cos(heading) * vx - np.sin(heading) * vy)
    wanted_y = 2.5 + 3.0 * np.mean(np.sin(heading) * vx + np.cos(heading) * vy)
    assert math.hypot(robot.pose.x_m - wanted_x, robot.pose.y_m - wanted_y) < 1e-3
    assert robot.pose.heading_rad == pytest.approx(0.7 + 3.0 * rate, abs=1e-3)
    assert robot.yaw_rate_radps(robot.now_s) == pytest.approx(rate, abs=1e-9)
    turned = np.array(robot.counts()) / COUNTS_PER_RAD
    wanted = np.array(KINEMATICS.wheel_speeds(*velocity)) * 3.0
    np.testing.assert_allclose(turned, wanted, atol=0.02)


def test_a_wheel_lags_behind_its_duty_by_the_time_constant(hall):
    config = replace(IDEAL, simulation=SimulationConfig(slip_std=0.0, motor_lag_s=0.1))
    robot = body(hall, config=config)
    robot.advance(0.1, (0.5, 0.5, 0.5))
    speed = 0.5 * FULL_RADPS
    gone = speed * (0.1 - 0.1 * (1 - math.exp(-1)))  # integral of the exponential approach
    assert robot.counts()[0] == math.floor(gone * COUNTS_PER_RAD)


def test_the_length_of_a_step_does_not_matter_without_slip(hall):
    one, other = body(hall), body(hall)
    for _ in range(100):
        one.advance(one.now_s + 0.02, duties(0.3, 0.0, 0.4))
    for _ in range(400):
        other.advance(other.now_s + 0.005, duties(0.3, 0.0, 0.4))
    assert one.pose.distance_m(other.pose) < 1e-4
    assert one.counts() == other.counts()


def test_slip_is_invisible_to_the_encoders_and_of_the_size_asked_for(hall):
    config = replace(IDEAL, simulation=SimulationConfig(slip_std=0.0, slip_bias_std=0.02))
    ratios = []
    for seed in range(60):
        robot = body(hall, config=config, seed=seed)
        drive(robot, 2.0, 0.0, 0.0, 1.0)
        counted = sum(robot.counts()) / 3 / COUNTS_PER_RAD * 0.05 / 0.15
        ratios.append(robot.pose.heading_rad / counted)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.008)
    assert np.std(ratios) == pytest.approx(0.02 / math.sqrt(3), rel=0.4)


def test_same_seed_same_way_other_seed_other_way(hall):
    config = replace(Config(), simulation=SimulationConfig(slip_std=0.05))
    robots = [body(hall, config=config, seed=seed) for seed in (1, 1, 2)]
    for robot in robots:
        drive(robot, 2.0, 0.3, 0.0, 0.2)
    assert robots[0].pose == robots[1].pose
    assert robots[0].pose != robots[2].pose
    assert robots[0].counts() == robots[2].counts()


def test_a_wall_stops_the_body_at_its_radius_and_counts_once(hall):
    robot = body(hall)
    drive(robot, 20.0, 0.4)  # 8 m of wheel turning, 4.7 m of room
    assert robot.pose.x_m == pytest.approx(7.0 - 0.05 - 0.2, abs=1e-6)
    assert robot.collisions == 1
    assert robot.inputs().bumper
    assert robot.path_length_m == pytest.approx(4.75, abs=0.01)
    drive(robot, 1.0, -0.2)
    assert not robot.inputs().bumper
    drive(robot, 2.0, 0.2)
    assert robot.collisions == 2


def test_the_body_slides_along_a_wall_and_never_enters_one(hall):
    walls = hall.is_occupied.copy()
    walls[60:64, 70:74] = True
    world = World(walls, 0.05)
    rng = np.random.default_rng(5)
    robot = body(world)
    for _ in range(60):
        heading = rng.uniform(-math.pi, math.pi)
        drive(robot, 2.0, 0.5 * math.cos(heading), 0.5 * math.sin(heading))
        wall = world.clearance.nearest_wall(robot.pose.x_m, robot.pose.y_m)
        assert wall.distance_m >= 0.2 - 1e-5
    assert robot.collisions > 3
    robot = body(world, x=2.0, y=0.4)
    drive(robot, 2.0, 0.3, -0.3)  # half of it into the wall below
    assert robot.pose.x_m == pytest.approx(2.6, abs=0.01)
    assert robot.pose.y_m == pytest.approx(0.25, abs=1e-5)
    assert robot.collisions == 1


def test_true_poses_at_any_time(hall):
    robot = body(hall)
    drive(robot, 2.0, 0.3)
    drive(robot, 5.0, 0.0)
    drive(robot, 1.0, 0.3)
    stamps = np.array([7.5, -1.0, 0.0, 1.0, 5.0, 8.02])
    x = robot.poses_at(stamps)[:, 0]
    np.testing.assert_allclose(x, [2.75, 2.0, 2.0, 2.3, 2.6, 2.906], atol=2e-3)
    assert robot.poses_at(np.zeros(0)).shape == (0, 3)


def test_true_headings_are_wrapped_and_cross_pi_smoothly(hall):
    robot = body(hall, heading=3.1)
    drive(robot, 1.0, 0.0, 0.0, 0.2)
    headings = robot.poses_at(np.linspace(0.1, 1.0, 50))[:, 2]
    assert (np.abs(headings) <= math.pi).all()
    assert np.abs(np.diff(np.unwrap(headings))).max() < 0.01


def test_standing_still_needs_no_memory(hall):
    robot = body(hall)
    drive(robot, 30.0, 0.0)
    assert len(robot._history) < 5


def test_field_turns_with_the_body_and_is_bent_only_by_metal(hall):
    calm = replace(Config(), simulation=SimulationConfig(compass_disturbance=0.0))
    headings = [0.0, 1.0, -2.0]
    fields = [body(hall, heading=h, config=calm).field_gauss(0.0) for h in headings]
    for heading, (x, y, _) in zip(headings, fields, strict=True):
        assert math.atan2(x, y) == pytest.approx(heading)  # north is the world's +y
    bent = [body(hall, x=x).field_gauss(0.0)[:2] for x in np.linspace(0.5, 6.5, 40)]
    angles = np.degrees([math.atan2(x, y) for x, y in bent])
    assert np.abs(angles).max() > 10.0
    assert np.median(np.abs(angles)) < 10.0


def test_faults_happen_when_scheduled(hall):
    robot = body(hall)
    robot.faults.add(BodyFault.STUCK, 1.0, 2.0)
    robot.faults.add(BodyFault.SLIP_BURST, 4.0, 0.5)
    robot.faults.add(BodyFault.EMERGENCY_STOP, 0.0, 0.5)
    robot.faults.add(BodyFault.CLIFF, 0.5, 0.5)
    robot.faults.add(BodyFault.BATTERY_LOW, 5.0, 1.0)
    assert robot.inputs().emergency_stop
    assert not robot.inputs().cliff
    drive(robot, 0.7, 0.2)
    assert robot.inputs().cliff
    assert not robot.inputs().emergency_stop
    drive(robot, 0.8, 0.2)
    before, counts = robot.pose, robot.counts()
    drive(robot, 1.0, 0.2)
    assert robot.pose == before
    assert robot.counts() != counts
    drive(robot, 1.5, 0.2)
    assert robot.pose.heading_rad == pytest.approx(0.0, abs=1e-9)
    assert robot.inputs().battery_v > 12.0
    drive(robot, 1.1, 0.2)
    assert abs(robot.pose.heading_rad) > 0.03
    assert robot.inputs().battery_v < 10.0


def test_kidnap_moves_the_body_but_not_the_wheels(hall):
    robot = body(hall)
    drive(robot, 1.0, 0.2)
    counts = robot.counts()
    robot.kidnap(Pose2(5.0, 1.0, 1.0))
    assert (robot.pose, robot.counts()) == (Pose2(5.0, 1.0, 1.0), counts)
    with pytest.raises(InputError, match="does not fit"):
        robot.kidnap(Pose2(0.1, 1.0))
