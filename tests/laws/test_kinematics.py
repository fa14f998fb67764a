# SPDX-License-Identifier: MIT
"""Laws of the omni kinematics: one inverse, the published formula, one direction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ins_robot.config import WheelsConfig
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.errors import DegenerateGeometryError

SPEED = st.floats(-3.0, 3.0)
ANGLE = st.floats(0.0, 360.0)


def build(angles_deg: tuple[float, ...] = (60.0, 180.0, 300.0)) -> OmniKinematics:
    return OmniKinematics(replace(WheelsConfig(), angles_deg=angles_deg))


@given(ANGLE, ANGLE, ANGLE, SPEED, SPEED, SPEED)
def test_twist_undoes_wheel_speeds_at_any_angles(
    a: float, b: float, c: float, vx: float, vy: float, yaw: float
) -> None:
    gaps = [abs((p - q + 180.0) % 360.0 - 180.0) for p, q in ((a, b), (b, c), (c, a))]
    assume(min(gaps) > 5.0)
    kinematics = build((a, b, c))
    assert kinematics.twist(kinematics.wheel_speeds(vx, vy, yaw)) == pytest.approx(
        (vx, vy, yaw), abs=1e-9
    )


@given(SPEED, SPEED, SPEED)
def test_the_published_formula(vx: float, vy: float, yaw: float) -> None:
    """u_i = -sin(a) vx + cos(a) vy + L omega; back by sums, for wheels 120 degrees apart."""
    angles = [math.radians(60.0), math.radians(180.0), math.radians(300.0)]
    wheels = build().wheel_speeds(vx, vy, yaw)
    rims = [-math.sin(a) * vx + math.cos(a) * vy + 0.15 * yaw for a in angles]
    assert wheels == pytest.approx([rim / 0.05 for rim in rims], abs=1e-9)
    assert vx == pytest.approx(
        -2 / 3 * sum(math.sin(a) * u for a, u in zip(angles, rims, strict=True)), abs=1e-9
    )
    assert build().twist(wheels)[2] == pytest.approx(sum(rims) / (3 * 0.15), abs=1e-9)


def test_a_turn_on_the_spot_turns_all_wheels_alike_and_forward() -> None:
    assert build().wheel_speeds(0.0, 0.0, 1.0) == pytest.approx((3.0, 3.0, 3.0))


def test_driving_ahead_leaves_the_rear_wheel_standing() -> None:
    """The wheel at 180 degrees rolls on its rollers; those in front turn against each other."""
    left, rear, right = build().wheel_speeds(0.2, 0.0, 0.0)
    assert rear == pytest.approx(0.0, abs=1e-12)
    assert left == pytest.approx(-right)
    assert left < 0.0


def test_one_turn_of_all_wheels_is_known_by_its_counts() -> None:
    vx, vy, yaw = build().twist_from_counts((4096, 4096, 4096), 2.0)
    assert (vx, vy) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert yaw == pytest.approx(2.0 * math.pi * 0.05 / 0.15 / 2.0)


@given(SPEED, SPEED, SPEED)
def test_saturation_keeps_the_direction_and_tells(vx: float, vy: float, yaw: float) -> None:
    kinematics = build()
    wheels = kinematics.wheel_speeds(vx, vy, yaw)
    limited, was_limited = kinematics.limited(wheels)
    fastest = max(map(abs, wheels))
    assert was_limited == (fastest > 8.0)
    scale = min(1.0, 8.0 / fastest) if fastest else 1.0
    assert limited == pytest.approx(np.multiply(wheels, scale), abs=1e-9)
    assert kinematics.twist(limited) == pytest.approx(
        (vx * scale, vy * scale, yaw * scale), abs=1e-9
    )


def test_two_wheels_at_one_angle_are_refused() -> None:
    with pytest.raises(DegenerateGeometryError, match="same angle"):
        build((60.0, 180.0, 420.0))
