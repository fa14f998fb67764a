# SPDX-License-Identifier: MIT
"""The simulated sensors are as near to real ones as real recordings are to one another.

Needs ../shared/data, skips without it. Where the defaults are better than the recordings, and
why, is in docs/results.md, "The sensor".
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sensor_study import samples
from sensor_study.distance import Verdict, judge
from sensor_study.range_fit import fit_range_law

from ins_robot.config import Config

DATA = Path(__file__).parents[3] / "shared" / "data"
SIMULATION = Config().simulation
AS_LOSSY = replace(SIMULATION, reflectivity_spread=2.5, strength_lost=20.0)
WITHIN = """range noise over the law
equal readings in a row, 0.5 to 1 m
valid share in a box
error codes in a box
speed ripple, from the turn's mean
speed ripple, turn by turn
gyro noise at rest, std of 1 s
gyro bias, size of change in 10 to 40 s
odometry, turn in 0.5 m""".splitlines()
LOSSES = ["valid share, walls at 0.8 to 1.6 m", "valid share, walls at 2 to 3 m"]

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no public recordings in {DATA}")


@pytest.fixture(scope="module")
def real() -> samples.Recorded:
    return samples.read_all(DATA)


@pytest.fixture(scope="module")
def verdicts(real: samples.Recorded) -> dict[str, Verdict]:
    found = [judge(quantity) for quantity in samples.all_quantities(real, SIMULATION)]
    return {verdict.quantity.name: verdict for verdict in found}


@pytest.mark.parametrize("name", WITHIN)
def test_within_what_real_recordings_differ_by(verdicts: dict[str, Verdict], name: str) -> None:
    verdict = verdicts[name]
    assert verdict.is_within, (verdict.ks, verdict.allowed_ks, verdict.wasserstein)


def test_drop_outs_are_nearly_as_long(verdicts: dict[str, Verdict]) -> None:
    """Halves of the same two drives are nearer to one another than other rooms can be."""
    verdict = verdicts["drop-outs, length"]
    assert verdict.wasserstein < 2.0 * verdict.allowed_wasserstein


def test_it_can_lose_as_many_beams_as_the_real_one(real: samples.Recorded) -> None:
    homes = [samples.standing_turns(real, AS_LOSSY, 0)]
    found = {q.name: judge(q) for q in samples.in_rooms(real, homes, AS_LOSSY)}
    assert all(found[name].is_within for name in LOSSES)


def test_the_default_growth_of_noise_is_the_fitted_one(real: samples.Recorded) -> None:
    ranges_m = np.concatenate([still.steady_ranges_m for still in real.standstills])
    stds_m = np.concatenate([still.steady_stds_m for still in real.standstills])
    rng = np.random.default_rng(0)
    cubic = fit_range_law(ranges_m, stds_m, rng, 3.0)
    free = fit_range_law(ranges_m, stds_m, rng)
    assert free.exponent == pytest.approx(3.0, abs=3 * free.exponent_se)
    assert SIMULATION.range_std_per_m3 == pytest.approx(cubic.growth, abs=2 * cubic.growth_se)
    assert SIMULATION.range_std_floor_m == pytest.approx(cubic.floor_m, abs=1e-4)
