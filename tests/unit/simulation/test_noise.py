# SPDX-License-Identifier: MIT
"""Noise sources have the spread, memory and share they promise."""

import math

import numpy as np
import pytest

from ins_robot.simulation.noise import GaussianSource, OrnsteinUhlenbeck, Runs


def test_wandering_noise_has_unit_spread_and_forgets_over_its_time():
    noise = OrnsteinUhlenbeck(GaussianSource(np.random.default_rng(0)), 0.4)
    values = np.array([noise.step(0.1) for _ in range(40000)])
    assert values.std() == pytest.approx(1.0, abs=0.04)
    for lag in (1, 4):
        together = np.mean(values[lag:] * values[:-lag])
        assert together == pytest.approx(math.exp(-0.1 * lag / 0.4), abs=0.05)


def test_wandering_noise_keeps_its_spread_whatever_the_steps():
    noise = OrnsteinUhlenbeck(GaussianSource(np.random.default_rng(1)), 0.4)
    values = [noise.step(0.01 if n % 2 else 1.0) for n in range(20000)]
    assert np.std(values) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 1.0])
def test_runs_make_up_their_share_in_any_pieces(share):
    runs = Runs(np.random.default_rng(2), share, 2.5)
    rng = np.random.default_rng(3)
    values = np.concatenate([runs.draw(int(n)) for n in rng.integers(0, 50, 8000)])
    assert values.mean() == pytest.approx(share, abs=0.015)
    if 0 < share < 1:
        starts = (np.diff(values.astype(int)) == 1).sum()
        assert values.sum() / starts == pytest.approx(2.5, abs=0.2)


def test_runs_do_not_depend_on_how_they_are_asked_for():
    whole = Runs(np.random.default_rng(4), 0.2, 3.0).draw(5000)
    pieces = Runs(np.random.default_rng(4), 0.2, 3.0)
    np.testing.assert_array_equal(whole, np.concatenate([pieces.draw(50) for _ in range(100)]))
