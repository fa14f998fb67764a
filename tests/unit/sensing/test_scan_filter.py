# SPDX-License-Identifier: MIT
"""Five revolutions into one scan: what is believed, how well, and what is refused."""

import math

import numpy as np
import pytest

from ins_robot.config import LrfConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import LaserScan
from ins_robot.sensing.range_error import range_std_m
from ins_robot.sensing.scan_filter import combine, is_at_speed, select_sector

CONFIG = LrfConfig()
NAN = math.nan


def revolution(
    ranges_m: list[float] | np.ndarray,
    *,
    rpm: float = 200.0,
    stamp_s: float = 0.0,
    weak: int = -1,
) -> LaserScan:
    ranges = np.array(ranges_m, dtype=float)
    count = len(ranges)
    std_m = range_std_m(ranges, CONFIG.range_std_floor_m, CONFIG.range_std_per_m3)
    if weak >= 0:
        std_m[weak] *= CONFIG.weak_return_factor
    return LaserScan(
        stamp_s=stamp_s,
        bearings_rad=np.linspace(-math.pi, math.pi, count, endpoint=False),
        ranges_m=ranges,
        range_std_m=std_m,
        beam_offsets_s=0.3 * np.arange(count) / count,
        range_max_m=6.0,
        rpm=rpm,
        valid_counts=np.isfinite(ranges).astype(np.int64),
    )


def combined_beam(*readings_m: float) -> tuple[float, float, int]:
    """Range, standard deviation and count of one beam seen in so many revolutions."""
    scan = combine([revolution([r]) for r in readings_m], CONFIG)
    return float(scan.ranges_m[0]), float(scan.range_std_m[0]), int(scan.valid_counts[0])


def test_median_of_the_valid_ones_with_their_count() -> None:
    assert combined_beam(2.0, 2.01, NAN, 1.99, NAN)[::2] == (2.0, 3)


def test_two_that_agree_are_enough_and_one_is_not() -> None:
    assert combined_beam(NAN, 2.0, NAN, 2.01, NAN)[::2] == (pytest.approx(2.005), 2)
    value, std_m, count = combined_beam(NAN, NAN, 2.0, NAN, NAN)
    assert math.isnan(value)
    assert math.isnan(std_m)
    assert count == 0


def test_a_single_revolution_is_taken_as_it_is() -> None:
    assert combined_beam(2.0)[::2] == (2.0, 1)


def test_an_outlier_is_outvoted() -> None:
    assert combined_beam(2.0, 2.01, 4.7, 2.0, 1.99)[::2] == (2.0, 4)


@pytest.mark.parametrize("readings_m", [(1.0, 1.0, 2.1, 3.0, 3.0), (1.0, 3.0), (1, 1, 3, 3)])
def test_a_beam_across_an_edge_gives_no_wall_between(readings_m: tuple[float, ...]) -> None:
    value, _, _ = combined_beam(*readings_m)
    assert math.isnan(value)


def test_no_wall_appears_where_no_reading_was() -> None:
    rng = np.random.default_rng(2)
    near_far_m = np.where(rng.random((6, 2000)) < 0.5, 1.0, 4.0)
    ranges_m = near_far_m + rng.normal(0.0, 0.003, near_far_m.shape)
    ranges_m[rng.random(ranges_m.shape) < 0.4] = NAN
    scan = combine([revolution(row) for row in ranges_m], CONFIG)
    found_m = scan.ranges_m[scan.is_valid]
    assert len(found_m) > 300
    assert (np.minimum(abs(found_m - 1.0), abs(found_m - 4.0)) < 0.02).all()


def test_combining_is_unbiased_for_any_number_of_revolutions() -> None:
    rng = np.random.default_rng(4)
    for count in (1, 2, 3, 4, 5):
        noise_m = rng.normal(0.0, 0.013, (count, 20000))
        scan = combine([revolution(4.0 + row) for row in noise_m], CONFIG)
        assert abs(float(np.nanmean(scan.ranges_m)) - 4.0) < 0.0005


def test_the_error_shrinks_with_the_revolutions_but_not_below_the_floor() -> None:
    rng = np.random.default_rng(3)
    true_m, beams = 4.0, 400
    std_m = CONFIG.range_std_per_m3 * true_m**3
    single = revolution([true_m]).range_std_m[0]
    previous = single
    for count in (2, 5, 20):
        scans = [revolution(true_m + rng.normal(0.0, std_m, beams)) for _ in range(count)]
        scan = combine(scans, CONFIG)
        told_m = float(np.median(scan.range_std_m))
        actual_m = float(np.std(scan.ranges_m - true_m))
        assert CONFIG.range_std_floor_m < told_m < previous
        assert 0.6 * told_m < actual_m < 1.1 * told_m
        previous = told_m


def test_a_spread_larger_than_the_model_counts() -> None:
    calm = combined_beam(1.0, 1.0, 1.0, 1.0, 1.0)[1]
    restless = combined_beam(1.0, 1.03, 0.97, 1.02, 0.98)[1]
    assert restless > 2.0 * calm


def test_weak_returns_weigh_less() -> None:
    scan = combine([revolution([3.0, 3.0], weak=1)] * 5, CONFIG)
    assert scan.range_std_m[1] > 1.5 * scan.range_std_m[0]


def test_revolutions_off_the_set_speed_do_not_count() -> None:
    good, bad = revolution([2.0]), revolution([3.0], rpm=170.0)
    scan = combine([bad, bad, bad, good, good], CONFIG)
    assert (scan.ranges_m[0], scan.valid_counts[0], scan.rpm) == (2.0, 2, 200.0)


def test_the_set_speed_in_force_decides_not_the_configured_one() -> None:
    raised = [revolution([2.0], rpm=250.0)] * 3
    assert combine(raised, CONFIG, set_rpm=250.0).rpm == 250.0
    with pytest.raises(
        DeviceError, match=r"none of 3 revolutions ran at 200 rpm.*250, 250, 250"
    ):
        combine(raised, CONFIG)
    assert not is_at_speed(raised[0], CONFIG)
    assert is_at_speed(raised[0], CONFIG, 250.0)


def test_unknown_speed_of_a_log_is_taken() -> None:
    scan = combine([revolution([2.0], rpm=NAN)] * 2, CONFIG)
    assert scan.ranges_m[0] == 2.0
    assert math.isnan(scan.rpm)


def test_nothing_to_combine_is_a_named_error() -> None:
    with pytest.raises(DeviceError, match="none of 0 revolutions"):
        combine([], CONFIG)


def test_beams_that_never_answered_stay_silent_without_a_warning() -> None:
    scan = combine([revolution([NAN, NAN])] * 5, CONFIG)
    assert np.isnan(scan.ranges_m).all()
    assert np.isnan(scan.range_std_m).all()


def test_the_stamp_is_the_middle_and_offsets_are_gone() -> None:
    scan = combine([revolution([1.0] * 4, stamp_s=10.0 + 0.3 * k) for k in range(5)], CONFIG)
    assert scan.stamp_s == pytest.approx(0.5 * (10.0 + 11.2 + 0.225))
    assert not scan.beam_offsets_s.any()


def test_sector_across_the_back_is_contiguous_and_counter_clockwise() -> None:
    scan = revolution(1.0 + 0.01 * np.arange(360))
    sector = select_sector(scan, math.pi - 0.05, math.radians(10.0))
    relative = (sector.bearings_rad - (math.pi - 0.05) + math.pi) % (2 * math.pi) - math.pi
    assert len(relative) == 20
    assert (np.diff(relative) > 0).all()
    assert np.abs(relative).max() <= math.radians(10.0) + 1e-9
    for bearing, range_m in zip(sector.bearings_rad, sector.ranges_m, strict=True):
        assert range_m == scan.ranges_m[np.argmin(np.abs(scan.bearings_rad - bearing))]


def test_sector_takes_the_beams_on_its_edges() -> None:
    scan = revolution(np.full(360, 2.0))
    sector = select_sector(scan, 0.0, math.radians(150.0))
    assert len(sector.ranges_m) == 301
    assert select_sector(scan, 1.0, math.pi) is scan
