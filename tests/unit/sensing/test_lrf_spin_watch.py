# SPDX-License-Identifier: MIT
"""The rotor's watch: raises the set speed where it must, and calls a stall a stall."""

import dataclasses

import numpy as np
import pytest

from ins_robot.config import LrfConfig
from ins_robot.sensing.drivers.lrf_codec import PacketBatch
from ins_robot.sensing.drivers.lrf_spin_watch import SLOW_CODE, VERY_SLOW_CODE, SpinWatch

CONFIG = LrfConfig()
TICK_S = 0.02


def packets(code: int = 0, share: float = 1.0) -> PacketBatch:
    """Six packets, `share` of their readings with this error code."""
    codes = np.where(np.arange(24).reshape(6, 4) < 24 * share, code, 0)
    none = np.zeros((6, 4), dtype=int)
    return PacketBatch(
        index=np.arange(6), rpm=np.full(6, 200.0), distance_mm=none, strength=none,
        is_invalid=codes > 0, is_weak=none > 0, error_code=codes,
    )  # fmt: skip


def run(
    watch: SpinWatch,
    start_s: float,
    seconds: float,
    batch: PacketBatch | None,
    rpm: float = 200.0,
) -> tuple[float, str | None]:
    """Feed it for a while; ends early with the first fault or wish for speed."""
    now_s = start_s
    while now_s < start_s + seconds:
        now_s += TICK_S
        if batch is not None:
            watch.see(batch, rpm, now_s)
        if fault := watch.fault(now_s):
            return now_s, fault
        if watch.faster_rpm() is not None:
            break
    return now_s, None


def started(config: LrfConfig = CONFIG) -> SpinWatch:
    watch = SpinWatch(config)
    watch.start(0.0)
    return watch


def test_a_healthy_rotor_is_left_alone() -> None:
    watch = started()
    assert run(watch, 0.0, 60.0, packets()) == (pytest.approx(60.0, abs=0.03), None)
    assert watch.is_steady
    assert watch.faster_rpm() is None


def test_other_error_codes_are_not_slowness() -> None:
    watch = started()
    assert run(watch, 0.0, 5.0, packets(0x35))[1] is None
    assert watch.faster_rpm() is None


@pytest.mark.parametrize("code", [SLOW_CODE, VERY_SLOW_CODE])
def test_too_slow_at_the_set_speed_raises_it_by_a_step_up_to_the_limit(code: int) -> None:
    watch = started(dataclasses.replace(CONFIG, rpm_max=240.0))
    now_s, tried = 0.0, []
    for _ in range(4):
        now_s, fault = run(watch, now_s, 0.5, packets(code), rpm=watch.set_rpm)
        assert fault is None
        faster_rpm = watch.faster_rpm()
        if faster_rpm is not None:
            tried.append(faster_rpm)
            watch.set_rpm = faster_rpm
            watch.start(now_s)
    assert tried == [225.0, 240.0]
    assert "only 'too slow' readings" in (run(watch, now_s, 3.0, packets(code), 240.0)[1] or "")


def test_the_controllers_own_limit_ends_the_raising() -> None:
    watch = started(dataclasses.replace(CONFIG, rpm=290.0, rpm_max=349.0))
    run(watch, 0.0, 0.5, packets(SLOW_CODE), rpm=290.0)
    assert watch.faster_rpm() == 315.0
    watch.set_rpm = 315.0
    watch.confirm(300.0)  # "Setting to maximum 300.00"
    watch.start(0.5)
    run(watch, 0.5, 0.5, packets(SLOW_CODE), rpm=300.0)
    assert watch.set_rpm == 300.0
    assert watch.faster_rpm() is None


def test_while_still_spinning_up_nothing_is_raised() -> None:
    watch = started()
    run(watch, 0.0, 1.0, packets(VERY_SLOW_CODE), rpm=120.0)
    assert watch.faster_rpm() is None


def test_some_slow_readings_are_tolerated() -> None:
    watch = started()
    assert run(watch, 0.0, 10.0, packets(SLOW_CODE, share=0.4))[1] is None
    assert watch.faster_rpm() is None


def test_silence_is_a_stall_sooner_once_packets_came() -> None:
    assert run(started(), 0.0, 9.0, None)[0] == pytest.approx(3.0, abs=0.05)
    watch = started()
    now_s, _ = run(watch, 0.0, 1.0, packets())
    end_s, fault = run(watch, now_s, 9.0, None)
    assert end_s - now_s == pytest.approx(0.5, abs=0.05)
    assert fault is not None
    assert "no good packet for 0.5 s" in fault


def test_only_too_slow_readings_for_two_seconds_is_a_stall() -> None:
    watch = started()
    now_s, _ = run(watch, 0.0, 1.0, packets())
    end_s, fault = run(watch, now_s, 9.0, packets(VERY_SLOW_CODE), rpm=100.0)
    assert end_s - now_s == pytest.approx(2.0, abs=0.05)
    assert fault is not None
    assert "100 rpm, set 200 rpm" in fault


def test_never_reaching_the_set_speed_is_a_fault() -> None:
    end_s, fault = run(started(), 0.0, 20.0, packets(), rpm=180.0)
    assert end_s == pytest.approx(CONFIG.spin_up_timeout_s, abs=0.05)
    assert fault is not None
    assert "not at the set speed" in fault
