# SPDX-License-Identifier: MIT
"""What the odometry is worth, told by the scans that correct it."""

import numpy as np
import pytest

from ins_robot.core.drift_meter import LOOKS_MAX, LOOKS_MIN, WAY_MIN_M, DriftMeter


def looked(meter, off_m, way_m):
    meter.drove(way_m)
    meter.located(off_m)


@pytest.mark.parametrize("drift", [0.01, 0.05])
def test_the_drift_that_was_is_told(drift):
    meter, rng = DriftMeter(), np.random.default_rng(3)
    for way_m in rng.uniform(WAY_MIN_M, 2.0, LOOKS_MAX):
        looked(meter, abs(rng.normal(0.0, drift * way_m)), way_m)
    assert meter.per_m == pytest.approx(drift, rel=0.3)


def test_nothing_is_told_of_a_few_looks_or_of_short_ways():
    meter = DriftMeter()
    for _ in range(LOOKS_MIN - 1):
        looked(meter, 0.1, 1.0)
    for _ in range(50):
        looked(meter, 0.1, 0.5 * WAY_MIN_M)
    assert meter.per_m == 0.0
    looked(meter, 0.1, 1.0)
    assert meter.per_m == pytest.approx(0.1)


def test_scans_that_located_nothing_leave_their_ways_to_the_next():
    meter = DriftMeter()
    for _ in range(LOOKS_MIN):
        for _ in range(4):
            meter.drove(0.5)
        meter.located(0.1)
    assert meter.per_m == pytest.approx(0.1 / 2.0)


def test_what_the_map_moved_by_is_not_drift():
    meter = DriftMeter()
    for _ in range(LOOKS_MIN):
        looked(meter, 0.01, 1.0)
    meter.drove(1.0)
    meter.interrupted()
    looked(meter, 0.01, 1.0)
    assert meter.per_m == pytest.approx(0.01)


def test_a_push_is_forgotten():
    meter = DriftMeter()
    looked(meter, 1.0, 0.5)
    for _ in range(LOOKS_MAX):
        looked(meter, 0.01, 1.0)
    assert meter.per_m == pytest.approx(0.01)
