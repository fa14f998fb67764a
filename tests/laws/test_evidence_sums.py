# SPDX-License-Identifier: MIT
"""Law of evidence sums: scans laid on as one step are the scans one after the other."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.config import MapConfig
from ins_robot.mapping.evidence_sums import UNIT, EvidenceSums
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.mapping.scan_footprint import ScanFootprint


def footprint(rng):
    height, width = rng.integers(1, 12, 2)
    return ScanFootprint(
        corner=(int(rng.integers(-9, 9)), int(rng.integers(-9, 9))),
        evidence=rng.choice([-1.0, -0.3, 0.0, 0.37, 1.0], (height, width)).astype(np.float32),
        is_quiet=rng.random((height, width)) < 0.1,
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 40), st.floats(0.01, 9.0), st.floats(0.3, 7.0))
def test_a_sum_does_what_its_scans_do(seed, split, hit, limit):
    """Wherever the cells were before, and however often the clamp was reached."""
    config = MapConfig(hit_log_odds=hit, miss_log_odds=0.4, log_odds_max=limit)
    rng = np.random.default_rng(seed)
    scans = [footprint(rng) for _ in range(40)]
    one_by_one = OccupancyGrid(0.05, config)
    before, after = EvidenceSums(config), EvidenceSums(config)
    for k, scan in enumerate(scans):
        one_by_one.add(scan)
        (before if k < split else after).add(scan)
    row, col = one_by_one.cells(np.zeros(2)).tolist()
    units = np.zeros(one_by_one.shape, np.int16)
    is_quiet = np.zeros(units.shape, bool)
    for sums in (before, after):
        sums.lay_on(units, is_quiet, (-row, -col))
    assert (units * np.float32(UNIT) == one_by_one.log_odds).all()
    assert (is_quiet == one_by_one.is_quiet).all()
