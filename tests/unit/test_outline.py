# SPDX-License-Identifier: MIT
"""Outlines that people give: what is no polygon is told in words, in the configuration too."""

import math

import numpy as np
import pytest

from ins_robot.config import Config, load, loads, to_toml
from ins_robot.errors import ConfigError
from ins_robot.geometry.polygon import contains
from ins_robot.outline import flaw_of, is_inside

SQUARE = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
L_SHAPE = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 4.0), (0.0, 4.0))


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("corners", [SQUARE, L_SHAPE, L_SHAPE[::-1], SQUARE[:3]])
def test_a_polygon_has_no_flaw_wherever_it_begins(corners, turn):
    assert flaw_of(corners[turn % len(corners) :] + corners[: turn % len(corners)]) is None


@pytest.mark.parametrize(
    ("corners", "says"),
    [
        ([], "0 corners"),
        ([(0, 0), (1, 1)], "2 corners"),
        ([(0, 0), (2, 2), (2, 0), (0, 2)], "crosses itself"),
        ([(0, 0), (1, 0), (2, 0)], "it"),
        ([(0, 0), (4, 0), (4, 1), (2, 1), (2, 0), (1, 0), (1, 1), (0, 1)], "crosses itself"),
        ([(0, 0), (1, 0), (1, 0.00001)], "no area"),
        ([(0, 0), (1001, 0), (0, 1)], "further than 1000 m"),
        ([(math.cos(k / 40), math.sin(k / 40)) for k in range(250)], "at most 200"),
    ],
)
def test_what_is_none_is_told(corners, says):
    assert says in flaw_of(corners)


def test_inside_is_the_same_for_one_point_and_for_many():
    points = np.random.default_rng(0).uniform(-1.0, 5.0, (300, 2))
    for corners in (SQUARE, L_SHAPE):
        many = contains(np.array(corners), points)
        assert many.any()
        assert many.tolist() == [is_inside(corners, (x, y)) for x, y in points.tolist()]


@pytest.mark.parametrize(
    ("boundary", "says"),
    [
        ("[]", "at least 3"),
        ("[[-1, -1], [1, 1], [1, -1], [-1, 1]]", "crosses itself"),
        ("[[1, 1], [2, 1], [2, 2]]", "start [0, 0] lies outside"),
        ("[1, 2, 3]", "list of corners"),
        ("[[-1, -1], [1, -1], [1, nan]]", "finite"),
    ],
)
def test_a_bad_boundary_is_one_line(boundary, says):
    with pytest.raises(ConfigError) as raised:
        load(None, [f"exploration.boundary={boundary}"])
    assert says in str(raised.value)
    assert "exploration.boundary" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_an_unknown_strategy_is_one_line():
    with pytest.raises(
        ConfigError, match=r"exploration\.strategy = \"greedy\": must be one of"
    ):
        load(None, ["exploration.strategy=greedy"])


def test_a_boundary_survives_its_file():
    config = load(None, ["exploration.boundary=[[-1, -1], [3, -1], [3, 2], [-1, 2]]"])
    assert loads(to_toml(config), "text") == config
    assert loads(to_toml(Config()), "text").exploration.boundary is None
