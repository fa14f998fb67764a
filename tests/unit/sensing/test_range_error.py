# SPDX-License-Identifier: MIT
"""The one law of range noise: floor near, the cube of range far."""

import numpy as np

from ins_robot.config import Config
from ins_robot.sensing.range_error import range_std_m


def test_near_it_is_the_floor_and_far_twice_the_range_is_eight_times_the_noise() -> None:
    near, far, twice = range_std_m(np.array([0.0, 10.0, 20.0]), 0.003, 0.001)
    assert near == 0.003
    np.testing.assert_allclose(twice / far, 8.0, rtol=1e-4)


def test_it_keeps_shape_and_no_reading_stays_none() -> None:
    std_m = range_std_m(np.array([[1.0, np.nan], [2.0, 3.0]]), 0.0, np.array([0.001, 0.002]))
    np.testing.assert_allclose(std_m, [[0.001, np.nan], [0.008, 0.054]])


def test_robot_and_simulator_have_the_same_growth() -> None:
    config = Config()
    assert config.lrf.range_std_per_m3 == config.simulation.range_std_per_m3
    assert config.lrf.range_std_floor_m >= config.simulation.range_std_floor_m
