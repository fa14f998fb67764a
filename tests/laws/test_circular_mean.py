# SPDX-License-Identifier: MIT
"""Equation 5 of the paper: the orientation estimate is sine over cosine, not as printed."""

import math

import numpy as np
import pytest

from ins_robot.geometry.angles import circular_mean_rad, wrap_rad

CLOUD = np.linspace(-0.4, 0.4, 41)


@pytest.mark.parametrize("heading_deg", [0, 30, 90, 135, 180, -90, -100])
def test_a_cloud_around_a_heading_has_that_mean_in_every_quadrant(heading_deg):
    heading = math.radians(heading_deg)
    mean = circular_mean_rad(wrap_rad(heading + CLOUD))
    assert wrap_rad(mean - heading) == pytest.approx(0.0, abs=1e-12)


def test_as_printed_it_is_the_complement():
    """Right at 45 degrees by chance, and nowhere else."""
    for heading_deg in (10, 45, 80):
        angles = math.radians(heading_deg) + CLOUD
        printed = math.atan(np.cos(angles).sum() / np.sin(angles).sum())
        assert math.degrees(printed) == pytest.approx(90 - heading_deg)


def test_weights_count_and_a_turn_more_does_not():
    angles, weights = np.array([0.2, 0.6, 3.0]), np.array([3.0, 1.0, 0.0])
    mean = circular_mean_rad(angles, weights)
    assert circular_mean_rad(angles[:2].repeat([3, 1])) == pytest.approx(mean)
    assert circular_mean_rad(angles + 2.0 * math.pi, weights) == pytest.approx(mean)
