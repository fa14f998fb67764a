# SPDX-License-Identifier: MIT
"""The device clock: stamps are steady while arrivals are not."""

from __future__ import annotations

import numpy as np
import pytest

from ins_robot.sensing.drivers.device_clock import DeviceClock


def stamps_of(
    rng: np.random.Generator, count: int, skew: float = 0.0, first_ms: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True times, arrivals (2 ms late and up to 15 ms more, often little), and stamps."""
    true_s = 1000.0 + 0.02 * np.arange(count) * (1.0 + skew)
    delay_s = 0.002 + 0.015 * rng.random(count) ** 3
    arrivals_s = np.maximum.accumulate(true_s + delay_s)
    clock = DeviceClock()
    stamps = [
        clock.stamp((first_ms + 20 * i) & 0xFFFFFFFF, float(a))
        for i, a in enumerate(arrivals_s)
    ]
    return true_s, arrivals_s, np.array(stamps, dtype=np.float64)


def test_stamps_have_a_tenth_of_the_jitter_of_arrivals() -> None:
    true_s, arrivals_s, stamps = stamps_of(np.random.default_rng(1), 2000)
    jitter = np.std((stamps - true_s)[100:])
    assert jitter < 0.1 * np.std((arrivals_s - true_s)[100:])
    assert jitter < 0.3e-3
    assert np.all(stamps <= arrivals_s + 1e-9)
    assert np.all(np.diff(stamps) >= 0.0)


@pytest.mark.parametrize("skew", [100e-6, -100e-6, 5e-3, -5e-3])
def test_a_clock_that_runs_fast_or_slow_is_followed(skew: float) -> None:
    """Crystals are 100 ppm off, ceramic resonators 0.5 %: the lag stays at AGEING_S x skew."""
    true_s, _, stamps = stamps_of(np.random.default_rng(2), 6000, skew)
    late = (stamps - true_s - 0.002)[1000:]
    assert np.max(np.abs(late)) < 10.0 * abs(skew) + 0.002


def test_wrap_of_the_32_bit_milliseconds_goes_unnoticed() -> None:
    _, _, plain = stamps_of(np.random.default_rng(3), 500)
    _, _, wrapped = stamps_of(np.random.default_rng(3), 500, first_ms=2**32 - 3000)
    assert np.array_equal(plain, wrapped)


def test_a_late_start_is_corrected_and_time_never_turns_back() -> None:
    """The first frames waited half a second in a buffer, then all came at once."""
    clock = DeviceClock()
    true_s = 10.0 + 0.02 * np.arange(100)
    stamps = [clock.stamp(20 * i, max(10.5, float(true))) for i, true in enumerate(true_s)]
    assert np.all(np.diff(np.array(stamps, dtype=np.float64)) >= 0.0)
    assert stamps[30:] == pytest.approx(true_s[30:], abs=1e-3)


@pytest.mark.parametrize("time_ms", [1000, 999, 980, 1000 + 10_001, 1000 + 2**31])
def test_a_step_that_cannot_be_is_refused_and_forgotten(time_ms: int) -> None:
    clock = DeviceClock()
    clock.stamp(1000, 5.0)
    assert clock.stamp(time_ms, 5.02) is None
    assert clock.stamp(1020, 5.02) == pytest.approx(5.02)
    assert clock.device_s == pytest.approx(0.02)
