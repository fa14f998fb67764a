# SPDX-License-Identifier: MIT
"""Places that people name, home among them, and what the end of a run knows of itself."""

import math

import numpy as np
import pytest
from changing_world import tell
from exploring import configured, plan, scan_of

from ins_robot.errors import StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.decisions import Ending, Finished
from ins_robot.navigation.leftovers import leftovers
from ins_robot.navigation.way_home import WayHome

ROOM = plan(10, 8, (0.5, 0.5, 9.5, 7.5))
TWO_ROOMS = plan(8, 5, (0.5, 0.5, 3.5, 4.5), (3.5, 2.0, 3.6, 2.9), (3.6, 0.5, 7.5, 4.5))
START = Pose2(3.0, 4.0, 0.0)
ONE_SCAN = configured(max_scans=1, return_home=False)


@pytest.mark.parametrize("readings", [0, 5])
def test_nothing_is_driven_to_blindly(readings):
    """A few stray readings are no sight."""
    explorer = (story := tell(ROOM, START, ONE_SCAN)).explorer
    ranges = np.full(360, np.nan)
    ranges[:readings] = 2.0
    for number in (1, 2, 3, 4):
        scan = scan_of(ranges, np.radians(np.arange(-180.0, 180.0)))
        explorer.observe(number, float(number), Pose2(), scan, (0.0, math.pi))
    with pytest.raises(StateError, match="LRF covered"):
        explorer.send_to(np.array([2.2, 1.0]), Pose2(), story.grid)
    explorer.blindness.glimpsed(story.robot.scan(math.pi))  # uncovered
    assert explorer.send_to(np.array([2.2, 1.0]), Pose2(), story.grid)


def test_a_place_at_home_is_home_facing_as_there():
    story = tell(ROOM, START, ONE_SCAN)
    drive = story.explorer.send_to(np.array([0.05, 0.03]), Pose2(1.0, 1.0, 2.0), story.grid)
    assert drive.place.distance_m(Pose2()) < 0.04
    assert drive.place.heading_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("x_m", [0.0, 0.07])
def test_a_robot_at_home_turns_to_face_as_it_did(x_m):
    story = tell(ROOM, START, ONE_SCAN)
    explorer, ending = story.explorer, Ending("enough", True)
    way = WayHome(explorer.graph, explorer.bounds, is_wanted=True)
    turned = explorer._look_around(Pose2(x_m, 0.0, 2.0), story.grid)
    path = way.step(turned, ending)
    assert isinstance(path, PlannedPath)
    assert path.headings_rad[-1] == pytest.approx(0.0, abs=1e-9)
    assert (
        way.step(explorer._look_around(Pose2(x_m, 0.0, 0.03), story.grid), ending) == "enough"
    )


def test_a_place_whose_way_is_blocked_again_and_again_is_given_up():
    story = tell(ROOM, START, ONE_SCAN)
    explorer = story.explorer
    explorer.send_to(np.array([2.2, 1.0]), Pose2(), story.grid)
    again = 0
    while not isinstance(explorer.decide(Pose2(), story.grid), Finished):
        again += 1
        assert again < 20
    assert again > 4


def test_at_the_end_every_node_has_its_neighbours():
    """The limit ends exploring in the other room; the last node is the one at home."""
    story = tell(TWO_ROOMS, Pose2(1.5, 2.5, 0.0), configured(max_scans=3))
    assert story.robot.pose.distance_m(Pose2()) < 0.1
    assert len(story.explorer.graph) == 4
    assert all(node["neighbours"] for node in story.explorer.as_json()["nodes"])


def test_what_is_left_is_of_the_map_at_the_end():
    """What the way home has shown is not left unseen."""
    story = tell(TWO_ROOMS, Pose2(1.5, 2.5, 0.0), configured(max_scans=1))
    explorer, robot = story.explorer, story.robot
    robot.pose = Pose2(3.5, 0.0, 0.0)
    story.grid.integrate(robot.scan(math.pi), robot.pose, 3.0)
    end = explorer.decide(Pose2(), story.grid)
    scene = explorer._look_around(Pose2(), story.grid)
    now = leftovers(scene, explorer.graph, explorer.bounds, unfinished=end.reason)
    assert end.unseen == now != story.decision.unseen
