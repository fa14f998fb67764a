# SPDX-License-Identifier: MIT
"""A person puts the LRF down about where asked, never in a wall, and obeys typed lines."""

import math

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.carry_orders import obey
from ins_robot.simulation.person import Person
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.virtual_clock import run_virtual
from ins_robot.simulation.world import World


def person_in(name: str, seed: int = 0) -> tuple[Person, RobotBody]:
    config, world = Config(), World.builtin(name)
    start = world.start_pose(None, config.robot.radius_m)
    body = RobotBody(world, start, config, np.random.default_rng(seed))
    return Person(body, config.simulation, np.random.default_rng(seed)), body


def test_places_err_as_configured() -> None:
    person, body = person_in("open_room")
    start, off = body.pose, []
    for _ in range(400):
        body.carry(start)
        person.go(0.0, 0.0, 0.0)
        off.append(start.between(body.pose).as_array())
    mean, std = np.mean(off, axis=0), np.std(off, axis=0)
    assert np.abs(mean[:2]).max() < 0.03
    assert std[:2] == pytest.approx(0.15, rel=0.15)
    assert math.degrees(std[2]) == pytest.approx(10.0, rel=0.15)


def test_a_walk_takes_its_time_and_ends_clear_of_walls() -> None:
    for seed in range(5):
        person, body = person_in("rooms", seed)
        place = Pose2(0.3, 1.0, 2.0)
        points = np.array([[0.0, 0.0], [0.3, 0.5], [0.3, 1.0]])
        run_virtual(person.walk(points, place))
        assert (body.start @ place).distance_m(body.pose) < 0.7
        wall = body.world.clearance.nearest_wall(body.pose.x_m, body.pose.y_m)
        assert wall.distance_m >= body.radius_m
        assert body.path_length_m > 0.5
        assert body.collisions == 0


def test_lines_carry_and_nonsense_is_told() -> None:
    person, body = person_in("rooms")
    before = body.pose
    assert obey(person, "carry 0 0.1 45").startswith("put down at ")
    assert body.pose != before
    stays = body.pose
    for line in ("carry", "carry a b c", "carry 0 nan 0", "carry 0 -1 0", "walk 1 2 3"):
        assert "expected carry BEARING_DEG" in obey(person, line)
    assert "does not fit" in obey(person, "carry 0 500 0")
    assert body.pose == stays
