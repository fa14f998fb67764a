# SPDX-License-Identifier: MIT
"""A program that knows nothing of this project reads the emulated laser range finder."""

import statistics
from pathlib import Path

import numpy as np
import pytest
from lrf_line import StandingOptics, range_by_bearing_m
from xv11_reader import Reader

from ins_robot.simulation.emulators.lrf import LrfEmulator

CAPTURE = Path(__file__).parents[3] / "shared" / "data" / "xv11" / "hand_in_box.bin"


def test_the_independent_reader_is_right_about_a_real_sensor() -> None:
    if not CAPTURE.exists():
        pytest.skip("the capture is not beside the repository (../shared/data/xv11)")
    reader = Reader()
    reader.push(CAPTURE.read_bytes())
    assert reader.good == 11_451


@pytest.mark.parametrize("rpm", [200, 300])
def test_it_sees_full_turns_without_sending_more_than_a_speed(rpm: int) -> None:
    emulator = LrfEmulator(StandingOptics(), np.random.default_rng(0))
    reader = Reader()
    emulator.receive(b"SetRPM %d\r\n" % rpm, 0.0)
    for tick in range(1, 1000):  # 10 s of a host that polls at 100 Hz
        reader.push(emulator.advance(tick * 0.01))
    full = [turn for turn in reader.turns if len(turn) == 324]  # spinning up gives no full ones
    assert len(full) == pytest.approx(9.0 * rpm / 60.0, abs=2.0)
    assert statistics.median(reader.speeds) == pytest.approx(rpm, rel=0.01)
    assert full == reader.turns[-len(full) :]
    for turn in full[-5:]:
        for degree, (millimetres, strength) in turn.items():
            assert degree % 10  # every tenth beam gives a code, never a distance
            truth_mm = 1e3 * float(range_by_bearing_m(np.radians(float(degree))))
            assert abs(millimetres - truth_mm) <= 0.51
            assert strength == 400
