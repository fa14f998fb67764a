# SPDX-License-Identifier: MIT
"""What measures the sensors measures what was put in."""

import numpy as np
import pytest
from sensor_study.distance import judge
from sensor_study.quantity import Quantity
from sensor_study.range_fit import fit_range_law
from sensor_study.standstill import Standstill, lost_run_lengths

ALL = np.ones(360, dtype=bool)


@pytest.mark.parametrize("exponent", [2.0, 3.0])
def test_the_fit_finds_the_law_within_its_own_error(exponent: float) -> None:
    rng = np.random.default_rng(1)
    ranges_m = rng.uniform(0.4, 5.0, 500)
    true_m = np.hypot(4e-4, 1e-3 * ranges_m**exponent)
    measured_m = true_m * np.exp(0.4 * rng.standard_normal(500))
    law = fit_range_law(ranges_m, measured_m, rng)
    assert law.exponent == pytest.approx(exponent, abs=4 * law.exponent_se)
    assert law.growth == pytest.approx(1e-3, abs=4 * law.growth_se)
    assert law.exponent_se < 0.1
    wrong = fit_range_law(ranges_m, measured_m, rng, exponent=5.0 - exponent, draws=2)
    assert wrong.cost > 1.2 * law.cost


def test_a_standstill_tells_noise_from_outliers_and_lost_beams() -> None:
    rng = np.random.default_rng(2)
    ranges_m = 2.0 + 0.01 * rng.standard_normal((40, 360))
    ranges_m[3, :100] = 3.0  # a mixed pixel
    ranges_m[5, 200:] = np.nan
    ranges_m[:, 350:] = np.nan
    still = Standstill("here", ranges_m, ALL)
    assert len(still.steady_ranges_m) == 350
    assert still.steady_stds_m.mean() == pytest.approx(0.01, rel=0.03)
    assert still.lost_share_of_seen().max() == pytest.approx(1 / 40)
    assert not still.repeated_share(1.0, 3.0).any()
    assert (Standstill("same", np.ones((4, 360)), ALL).repeated_share(0.5, 2.0) == 1.0).all()


def test_runs_of_lost_beams_are_counted_over_open_beams_only() -> None:
    turn = np.ones((1, 8))
    turn[0, [1, 2, 5, 7]] = np.nan
    is_open = np.array([1, 1, 1, 1, 1, 1, 0, 1], dtype=bool)
    assert lost_run_lengths(turn, is_open).tolist() == [2.0, 2.0]


def test_what_differs_more_than_the_real_parts_do_is_beyond() -> None:
    rng = np.random.default_rng(3)
    real = [rng.normal(mean, 1.0, 400) for mean in (0.0, 0.5)]
    for offset, is_within in ((0.25, True), (3.0, False)):
        simulated = [rng.normal(offset, 1.0, 400)]
        quantity = Quantity("it", "m", "two recordings", "", real, simulated)
        assert judge(quantity).is_within is is_within
