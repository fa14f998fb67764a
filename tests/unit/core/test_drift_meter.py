# SPDX-License-Identifier: MIT
"""What the odometry is worth, told by the scans that correct it."""

import numpy as np
import pytest

from ins_robot.core.drift_meter import LOOKS_MIN, WAY_MIN_M, DriftMeter


@pytest.mark.parametrize("drift", [0.01, 0.05])
def test_the_drift_that_was_is_told(drift):
    meter, rng = DriftMeter(), np.random.default_rng(3)
    for way_m in rng.uniform(WAY_MIN_M, 2.0, 400):
        meter.corrected(abs(rng.normal(0.0, drift * way_m)), way_m)
    assert meter.per_m == pytest.approx(drift, rel=0.15)


def test_nothing_is_told_of_a_few_looks_or_of_short_ways():
    meter = DriftMeter()
    for _ in range(LOOKS_MIN - 1):
        meter.corrected(0.1, 1.0)
    for _ in range(50):
        meter.corrected(0.1, 0.5 * WAY_MIN_M)
    assert meter.per_m == 0.0
    meter.corrected(0.1, 1.0)
    assert meter.per_m == pytest.approx(0.1)
