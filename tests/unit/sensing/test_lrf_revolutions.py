# SPDX-License-Identifier: MIT
"""Packets into revolutions: what becomes a range, and when each beam was measured."""

import dataclasses
import math

import numpy as np
import pytest

from ins_robot.config import LrfConfig
from ins_robot.messages import LaserScan
from ins_robot.sensing.drivers.lrf_codec import (
    PACKET_LINE_TIME_S,
    LrfCodec,
    PacketBatch,
    encode_packets,
)
from ins_robot.sensing.drivers.lrf_revolutions import RevolutionAssembler

CONFIG = LrfConfig()


def packets(index: np.ndarray, rpm: float = 200.0, **readings: np.ndarray) -> PacketBatch:
    """Packets that see 1 m everywhere, but for the `readings` given (n, 4)."""
    n = len(index)
    fields = {
        "distance_mm": np.full((n, 4), 1000),
        "strength": np.full((n, 4), 300),
        "is_invalid": np.zeros((n, 4), dtype=bool),
        "is_weak": np.zeros((n, 4), dtype=bool),
        "error_code": np.zeros((n, 4), dtype=int),
    } | readings
    return LrfCodec().feed(encode_packets(index, np.full(n, rpm), **fields))


def one_turn(config: LrfConfig = CONFIG, **readings: np.ndarray) -> LaserScan:
    (scan,) = RevolutionAssembler(config).push(packets(np.arange(90), **readings), 1.0)
    return scan


def beam_numbers(scan: LaserScan) -> np.ndarray:
    """(360,) place of each beam in the order of measurement."""
    return np.argsort(np.argsort(scan.beam_offsets_s))


def with_reading(
    name: str, beam: int, value: object, dtype: type = int
) -> dict[str, np.ndarray]:
    array = np.zeros((90, 4), dtype=dtype)
    if name == "distance_mm":
        array[:] = 1000
    array[beam // 4, beam % 4] = value
    return {name: array}


def range_of_beam(scan: LaserScan, beam: int) -> float:
    return float(scan.ranges_m[np.flatnonzero(beam_numbers(scan) == beam)[0]])


def test_a_turn_has_360_regular_beams_sorted_counter_clockwise() -> None:
    scan = one_turn()
    assert scan.bearings_rad[0] >= -math.pi
    assert scan.bearings_rad[-1] < math.pi
    np.testing.assert_allclose(np.diff(scan.bearings_rad), math.radians(1.0), atol=1e-9)
    assert scan.rpm == 200.0
    assert (scan.ranges_m == 1.0).all()
    assert (scan.valid_counts == 1).all()


@pytest.mark.parametrize(("yaw_deg", "is_clockwise"), [(0, 0), (-10, 0), (30, 1), (0.5, 1)])
def test_yaw_and_direction_turn_the_beams(yaw_deg: float, is_clockwise: int) -> None:
    config = dataclasses.replace(CONFIG, yaw_deg=yaw_deg, is_clockwise=bool(is_clockwise))
    distances = 1000 + np.arange(360).reshape(90, 4)
    scan = one_turn(config, distance_mm=distances)
    assert (np.diff(scan.bearings_rad) > 0).all()
    beam = np.rint(1e3 * scan.ranges_m) - 1000
    np.testing.assert_array_equal(beam, beam_numbers(scan))
    expected_rad = np.radians(yaw_deg + (-beam if is_clockwise else beam))
    off_rad = np.angle(np.exp(1j * (scan.bearings_rad - expected_rad)))
    assert np.abs(off_rad).max() < 1e-9


@pytest.mark.parametrize(
    ("distance_mm", "is_taken"), [(0, 0), (99, 0), (100, 1), (6000, 1), (6001, 0), (16383, 0)]
)
def test_the_range_gates(distance_mm: int, is_taken: int) -> None:
    value = range_of_beam(one_turn(**with_reading("distance_mm", 123, distance_mm)), 123)
    assert math.isfinite(value) == bool(is_taken)
    if is_taken:
        assert value == pytest.approx(1e-3 * distance_mm)


def test_no_error_code_becomes_a_distance() -> None:
    config = dataclasses.replace(CONFIG, range_min_m=0.0)
    codes = np.arange(360).reshape(90, 4) % 256
    scan = one_turn(config, is_invalid=np.ones((90, 4), dtype=bool), error_code=codes)
    assert np.isnan(scan.ranges_m).all()
    assert np.isnan(scan.range_std_m).all()
    assert not scan.valid_counts.any()


def test_noise_grows_with_the_cube_of_range_and_for_weak_returns() -> None:
    near, far = one_turn(), one_turn(distance_mm=np.full((90, 4), 4000))
    floor, k = CONFIG.range_std_floor_m, CONFIG.range_std_per_m3
    assert near.range_std_m[0] == pytest.approx(math.hypot(floor, k))
    assert far.range_std_m[0] == pytest.approx(math.hypot(floor, 64 * k))
    weak = one_turn(is_weak=np.ones((90, 4), dtype=bool))
    np.testing.assert_allclose(weak.range_std_m, CONFIG.weak_return_factor * near.range_std_m)


def test_lost_packets_are_missing_beams() -> None:
    index = np.delete(np.arange(90), [7, 8, 50])
    assembler = RevolutionAssembler(CONFIG)
    (scan,) = assembler.push(packets(index), 1.0)
    lost = np.isin(beam_numbers(scan) // 4, [7, 8, 50])
    np.testing.assert_array_equal(np.isnan(scan.ranges_m), lost)
    assert assembler.packets_missing == 3


@pytest.mark.parametrize("lost", [[89], [0], [88, 89, 0, 1]])
def test_turns_part_where_the_index_wraps_even_if_that_packet_is_lost(lost: list[int]) -> None:
    index = np.tile(np.delete(np.arange(90), lost), 4)
    assembler = RevolutionAssembler(CONFIG)
    scans = [
        s for part in np.array_split(index, 23) for s in assembler.push(packets(part), 1.0)
    ]
    scans += assembler.push(packets(np.array([2])), 1.0)
    valid = [int(scan.is_valid.sum()) for scan in scans]
    assert valid[-3:] == [360 - 4 * len(lost)] * 3


def test_a_turn_seen_from_its_middle_is_not_given() -> None:
    assembler = RevolutionAssembler(CONFIG)
    assert assembler.push(packets(np.arange(30, 90)), 1.0) == []
    assert len(assembler.push(packets(np.arange(90)), 1.3)) == 1


def test_half_turn_hops_of_a_slow_rotor_are_no_revolutions() -> None:
    assembler = RevolutionAssembler(CONFIG)
    index = (np.arange(400) * 45) % 90
    assert assembler.push(packets(index, rpm=60.0), 1.0) == []
    assert assembler.incomplete > 100


def test_a_short_glitch_of_the_speed_field_is_filtered() -> None:
    assembler = RevolutionAssembler(CONFIG)
    assembler.push(packets(np.arange(40)), 1.0)
    assembler.push(packets(np.arange(40, 55), rpm=351.0), 1.05)
    assert assembler.rpm == 200.0
    (scan,) = assembler.push(packets(np.arange(55, 90)), 1.17)
    assert scan.rpm == 200.0


@pytest.mark.parametrize("rpm", [180.0, 200.0, 297.0])
@pytest.mark.parametrize("chunk_s", [0.002, 0.02, 0.05])
def test_beam_times_are_right_at_constant_speed(rpm: float, chunk_s: float) -> None:
    packet_s = 60.0 / (90 * rpm)
    full_s = 0.0123 + packet_s * np.arange(90 * 12)  # last beam of each packet
    ready_s = full_s + PACKET_LINE_TIME_S
    assembler = RevolutionAssembler(CONFIG)
    scans: list[LaserScan] = []
    for tick in range(1, int(ready_s[-1] / chunk_s) + 2):
        here = np.flatnonzero((ready_s > (tick - 1) * chunk_s) & (ready_s <= tick * chunk_s))
        scans += assembler.push(packets(here % 90, rpm), tick * chunk_s)
    assert len(scans) == 12
    limit_s = min(chunk_s, packet_s) + 2e-4
    last_s = -math.inf
    for turn, scan in enumerate(scans):
        order = np.argsort(scan.beam_offsets_s)
        times_s = scan.stamp_s + scan.beam_offsets_s[order]
        true_s = full_s[90 * turn] + packet_s / 4 * (np.arange(360) - 3)
        error_s = times_s - true_s
        assert (np.diff(times_s) > 0).all()
        assert error_s.min() > -2e-4, f"turn {turn}: before it happened"
        assert error_s.max() < limit_s, f"turn {turn}"
        assert times_s[0] > last_s - 1e-4
        last_s = times_s[-1]


def test_beam_times_survive_a_late_delivery() -> None:
    """The host was busy for 150 ms: the packets come late, all at once, nothing is lost."""
    packet_s = 60.0 / (90 * 200.0)
    assembler = RevolutionAssembler(CONFIG)
    scans: list[LaserScan] = []
    for first in range(0, 900, 6):
        if 450 <= first < 492:
            continue
        index = np.arange(450 if first == 492 else first, first + 6)
        arrival_s = (
            packet_s * (first + 5) + PACKET_LINE_TIME_S + (0.01 if first == 492 else 0.0)
        )
        scans += assembler.push(packets(index % 90), arrival_s)
    assert len(scans) == 10
    stamps_s = np.array([scan.stamp_s for scan in scans])
    np.testing.assert_allclose(stamps_s, 0.3 * np.arange(10) - 0.75 * packet_s, atol=3e-3)


def test_a_long_silence_ends_the_turn_under_way() -> None:
    assembler = RevolutionAssembler(CONFIG)
    assembler.push(packets(np.arange(40)), 1.0)
    assert assembler.push(packets(np.arange(40, 90)), 3.0) == []
    assert len(assembler.push(packets(np.arange(90)), 3.3)) == 1
