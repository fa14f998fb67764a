# SPDX-License-Identifier: MIT
"""Between two places nothing is known but what was asked; while it stands, nothing moves."""

import math

import numpy as np
import pytest

from ins_robot.config import BaseConfig
from ins_robot.core.carried_odometry import CarriedOdometry
from ins_robot.geometry.pose2 import Pose2


def test_increments_chain_to_the_places_with_the_doubt_of_a_person() -> None:
    odometry = CarriedOdometry(BaseConfig(carried_std_m=0.2, carried_std_deg=10.0))
    places = [Pose2(), Pose2(1.0, 2.0, 0.5), Pose2(-1.0, 0.0, -2.0)]
    for k, place in enumerate(places):
        odometry.put_down(10.0 * k, place)
    there = odometry.increment(5.0, 25.0)
    chained = odometry.increment(5.0, 15.0).delta @ odometry.increment(15.0, 25.0).delta
    assert chained.as_array() == pytest.approx(there.delta.as_array())
    assert there.delta.as_array() == pytest.approx(places[2].as_array())
    assert np.sqrt(np.diag(there.covariance)) == pytest.approx([0.2, 0.2, math.radians(10.0)])
    assert not odometry.increment(11.0, 19.0).covariance.any()
    assert odometry.poses_at(np.array([25.0, 0.0]))[:, 0] == pytest.approx([-1.0, 0.0])
