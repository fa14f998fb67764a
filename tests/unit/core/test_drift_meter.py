# SPDX-License-Identifier: MIT
"""What the odometry is worth, told by the scans that correct it."""

import numpy as np
import pytest

from ins_robot.core.drift_meter import LOOKS_MAX, LOOKS_MIN, WAY_MIN_M, DriftMeter


class Drive:
    """A meter on its way."""

    def __init__(self):
        self.meter, self.at_m = DriftMeter(), 0.0

    def looked(self, off_m, way_m):
        self.at_m += way_m
        self.meter.located(off_m, self.at_m)


@pytest.mark.parametrize("drift", [0.01, 0.05])
def test_the_drift_that_was_is_told(drift):
    drive, rng = Drive(), np.random.default_rng(3)
    for way_m in rng.uniform(WAY_MIN_M, 2.0, LOOKS_MAX):
        drive.looked(abs(rng.normal(0.0, drift * way_m)), way_m)
    assert drive.meter.per_m == pytest.approx(drift, rel=0.3)


def test_nothing_is_told_of_a_few_looks_or_of_short_ways():
    drive = Drive()
    for _ in range(LOOKS_MIN - 1):
        drive.looked(0.1, 1.0)
    for _ in range(50):
        drive.looked(0.1, 0.5 * WAY_MIN_M)
    assert drive.meter.per_m == 0.0
    drive.looked(0.1, 1.0)
    assert drive.meter.per_m == pytest.approx(0.1)


def test_what_the_map_moved_by_is_not_drift():
    drive = Drive()
    for _ in range(LOOKS_MIN):
        drive.looked(0.01, 1.0)
    drive.at_m += 1.0
    drive.meter.interrupted(drive.at_m)
    drive.looked(0.01, 1.0)
    assert drive.meter.per_m == pytest.approx(0.01)


def test_a_push_is_forgotten():
    drive = Drive()
    drive.looked(1.0, 0.5)
    for _ in range(LOOKS_MAX):
        drive.looked(0.01, 1.0)
    assert drive.meter.per_m == pytest.approx(0.01)
