# SPDX-License-Identifier: MIT
"""Rates, ages, durations and counters."""

from __future__ import annotations

import json

import pytest

from ins_robot.daemon.health import Health


def watched(began_s: float) -> Health:
    health = Health(began_s)
    health.expect("lrf", None)  # rests between scans: never stale
    health.expect("imu", 0.5)
    health.expect("wheels", 0.5)
    return health


def run_for(health: Health, from_s: float, seconds: float, rate_hz: float) -> None:
    for tick in range(int(seconds * rate_hz)):
        health.beat("imu", from_s + tick / rate_hz)


def test_rates_are_of_the_last_window() -> None:
    health = watched(100.0)
    run_for(health, 100.0, 2.0, 50.0)
    health.roll(102.0)
    assert health.streams["imu"].rate_hz == pytest.approx(50.0)
    run_for(health, 102.0, 1.0, 20.0)
    assert health.streams["imu"].rate_hz == pytest.approx(50.0)  # the window is still open
    health.roll(103.0)
    health.roll(103.0)  # no time has passed: nothing to divide by
    assert health.streams["imu"].rate_hz == pytest.approx(20.0)
    assert health.streams["wheels"].rate_hz == 0.0


def test_silence_becomes_staleness() -> None:
    health = watched(10.0)
    assert health.stale(10.4) == []
    assert health.stale(10.6) == ["imu", "wheels"]  # never heard of counts from the start
    health.beat("imu", 10.6)
    health.beat("wheels", 10.6)
    assert health.stale(11.0) == []
    health.beat("imu", 11.0)
    assert health.stale(11.2) == ["wheels"]
    assert "STALE: wheels" in health.line(11.2)
    health.expect("wheels", 5.0)
    assert health.stale(15.0) == ["imu"]
    assert health.stale(1000.0) == ["imu", "wheels"]


def test_durations_show_mean_and_worst_of_the_window_and_the_worst_ever() -> None:
    health = watched(0.0)
    for duration_s in (0.001, 0.003, 0.008):
        health.took("control", duration_s)
    health.roll(1.0)
    health.took("control", 0.002)
    health.roll(2.0)
    timing = health.as_dict(2.0)["durations_ms"]["control"]
    assert timing == {"mean": 2.0, "worst": 2.0, "worst_ever": 8.0}
    health.roll(3.0)
    assert health.as_dict(3.0)["durations_ms"]["control"]["mean"] == 0.0


def test_line_and_dict_say_the_same() -> None:
    health = watched(0.0)
    health.count("scans dropped")
    health.count("scans dropped", 2)
    run_for(health, 0.0, 1.0, 50.0)
    health.took("control", 0.0015)
    health.roll(1.0)
    line, status = health.line(1.2), health.as_dict(1.2)
    assert line.startswith("stats: up 1 s, lrf 0.0 Hz, imu 50.0 Hz, wheels 0.0 Hz")
    assert "control 1.5/1.5 ms" in line
    assert "scans dropped 3" in line
    assert status["counters"] == {"scans dropped": 3}
    assert status["rates_hz"]["imu"] == 50.0
    assert status["ages_s"]["imu"] == pytest.approx(0.22)
    assert status["ages_s"]["lrf"] is None
    assert "\n" not in line
    json.dumps(status, allow_nan=False)
