# SPDX-License-Identifier: MIT
"""Where the robot faces at a place a strategy chose."""

import numpy as np
import pytest

from ins_robot.geometry.angles import wrap_rad
from ins_robot.navigation.aim_gap import facing_rad


def test_it_faces_the_mean_where_that_has_all_in_sight():
    assert facing_rad(np.array([0.2, 0.4, 0.9]), 2.6) == pytest.approx(0.5, abs=0.05)


def test_it_turns_its_blind_side_to_where_nothing_is():
    bearings = np.radians([100.0, 120.0, 140.0, -170.0, -100.0, -60.0, 60.0, 0.0])
    heading = facing_rad(bearings, np.radians(150.0))
    assert (np.abs(wrap_rad(bearings - heading)) < np.radians(150.0)).all()
