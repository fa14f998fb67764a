# SPDX-License-Identifier: MIT
"""Gyro bias at standstill and the gate of the compass."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ins_robot.config import ImuConfig
from ins_robot.geometry.angles import wrap_rad
from ins_robot.sensing.imu_calibration import CompassGate, FieldVerdict, StandstillBias

Field = tuple[float, float, float]


def earth(heading_rad: float, scale: float = 1.0) -> Field:
    """North at bearing 0.3 rad of odom, dip 60 deg."""
    off = 0.3 - heading_rad
    return 0.2 * scale * math.cos(off), 0.2 * scale * math.sin(off), -0.35 * scale


def test_bias_and_the_doubt_about_it() -> None:
    """Mean of the readings; the doubt is what the means of many starts really scatter by."""
    rng = np.random.default_rng(5)
    means, stds = [], []
    for _ in range(200):
        standstill = StandstillBias(ImuConfig(bias_time_s=1.0))
        bias = None
        for k in range(60):
            bias = standstill.add(0.02 * k, 0.03 + 1e-3 * float(rng.standard_normal()))
            if bias is not None:
                break
        assert bias is not None
        means.append(bias.bias_radps)
        stds.append(bias.std_radps)
    assert np.mean(means) == pytest.approx(0.03, abs=5e-5)
    assert np.mean(stds) == pytest.approx(np.std(means), rel=0.15)


def test_spread_is_refused_and_the_next_try_is_clean() -> None:
    standstill = StandstillBias(ImuConfig(bias_time_s=1.0, bias_std_max_dps=0.3))
    shaken = [standstill.add(0.02 * k, 0.02 * (-1) ** k) for k in range(51)]
    assert shaken == [None] * 51
    assert standstill.refusals == 1
    quiet = [standstill.add(2.0 + 0.02 * k, 0.01) for k in range(51)]
    assert quiet[-1] is not None
    assert quiet[-1].bias_radps == pytest.approx(0.01)


def test_a_steady_turn_is_no_bias() -> None:
    standstill = StandstillBias(ImuConfig(bias_time_s=1.0))
    assert all(standstill.add(0.02 * k, 0.6) is None for k in range(60))
    assert standstill.refusals == 1


def test_few_samples_are_not_enough() -> None:
    standstill = StandstillBias(ImuConfig(bias_time_s=1.0))
    assert all(standstill.add(0.5 * k, 0.01) is None for k in range(9))
    assert standstill.add(4.5, 0.01) is not None


def gate_with_reference() -> CompassGate:
    gate = CompassGate(ImuConfig())
    for _ in range(5):
        assert gate.learn(earth(0.0)) is FieldVerdict.LEARNT
    return gate


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -3.1, 7.0])
def test_bearing_of_the_field_is_the_same_at_every_heading(turn_rad: float) -> None:
    gate = gate_with_reference()
    for heading_rad in np.linspace(0.0, turn_rad, 20):
        field = earth(float(heading_rad))
        assert gate.judge(field, float(heading_rad)) is FieldVerdict.ACCEPTED
    assert gate.bearing_rad is not None
    assert wrap_rad(gate.bearing_rad - 0.3) == pytest.approx(0.0, abs=1e-9)


def test_a_field_that_turns_without_the_gyro_spoils_its_stretch() -> None:
    gate = gate_with_reference()
    for off_deg in (0.0, 1.0, 3.9):
        assert gate.judge(earth(math.radians(off_deg)), 0.0) is FieldVerdict.ACCEPTED
    assert gate.bearing_rad is not None
    assert gate.judge(earth(math.radians(5.0)), 0.0) is FieldVerdict.DISAGREES
    assert gate.bearing_rad is None
    gate.begin_stretch()
    assert gate.bearing_rad is None
    assert gate.judge(earth(math.radians(5.0)), 0.0) is FieldVerdict.ACCEPTED
    assert gate.bearing_rad == pytest.approx(0.3 - math.radians(5.0))


def test_what_is_no_field_of_the_earth_is_refused() -> None:
    gate = gate_with_reference()
    assert gate.judge(earth(0.0, 1.3), 0.0) is FieldVerdict.NORM
    assert gate.judge(earth(0.0, 0.7), 0.0) is FieldVerdict.NORM
    assert gate.judge((0.01, 0.01, -0.4), 0.0) is FieldVerdict.STEEP
    assert gate.judge((math.nan, 0.1, 0.1), 0.0) is FieldVerdict.IMPLAUSIBLE
    assert gate.judge((math.inf, 0.1, 0.1), 0.0) is FieldVerdict.IMPLAUSIBLE
    assert gate.bearing_rad is None
