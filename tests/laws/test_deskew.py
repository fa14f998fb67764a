# SPDX-License-Identifier: MIT
"""De-skewing: what a moving robot saw becomes what a standing one would have seen."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.geometry import pose2
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import LaserScan
from ins_robot.sensing.deskew import deskew

HALF_WIDTH_M, HALF_HEIGHT_M = 3.0, 2.0  # a rectangular room about the origin
TURN_S = 0.3
BEARINGS_RAD = np.radians(np.arange(-180.0, 180.0))
OFFSETS_S = TURN_S * (np.arange(360) + 180) % 360 / 360.0


def wall_ranges_m(odom_from_lrf: np.ndarray, bearings_rad: np.ndarray) -> np.ndarray:
    """(B,) distance to the room's wall from each pose (B, 3) along each bearing."""
    direction = odom_from_lrf[:, 2] + bearings_rad
    c, s = np.cos(direction), np.sin(direction)
    with np.errstate(divide="ignore"):
        to_x = (np.copysign(HALF_WIDTH_M, c) - odom_from_lrf[:, 0]) / c
        to_y = (np.copysign(HALF_HEIGHT_M, s) - odom_from_lrf[:, 1]) / s
    return np.minimum(to_x, to_y)


def scan_along(poses: np.ndarray, base_from_lrf: Pose2) -> LaserScan:
    odom_from_lrf = pose2.compose(poses, base_from_lrf.as_array())
    ranges_m = wall_ranges_m(odom_from_lrf, BEARINGS_RAD)
    return LaserScan(
        stamp_s=5.0,
        bearings_rad=BEARINGS_RAD.copy(),
        ranges_m=ranges_m,
        range_std_m=np.full(360, 0.003),
        beam_offsets_s=OFFSETS_S.copy(),
        range_max_m=6.0,
        rpm=200.0,
        valid_counts=np.ones(360, dtype=np.int64),
    )


def drive(start: Pose2, vx: float, vy: float, turn: float) -> np.ndarray:
    """(360, 3) poses at the beams' times, on a circle or a line."""
    steps = np.stack([vx * OFFSETS_S, vy * OFFSETS_S, turn * OFFSETS_S], axis=-1)
    return pose2.compose(start.as_array(), steps)


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.0, 1.0),
    heading=st.floats(-math.pi, math.pi),
    vx=st.floats(-0.5, 0.5),
    vy=st.floats(-0.5, 0.5),
    turn=st.floats(-2.0, 2.0),
    mount=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-3.0, 3.0)),
)
def test_a_scan_on_the_move_becomes_the_standing_scan(
    x: float, y: float, heading: float, vx: float, vy: float, turn: float,
    mount: tuple[float, float, float],
) -> None:  # fmt: skip
    start, base_from_lrf = Pose2(x, y, heading), Pose2(*mount)
    poses = drive(start, vx, vy, turn)
    still = deskew(scan_along(poses, base_from_lrf), poses, start.as_array(), base_from_lrf)
    odom_from_lrf = (start @ base_from_lrf).as_array()
    expected_m = wall_ranges_m(np.tile(odom_from_lrf, (360, 1)), still.bearings_rad)
    np.testing.assert_allclose(still.ranges_m, expected_m, atol=1e-9)
    assert not still.beam_offsets_s.any()
    assert (np.diff(still.bearings_rad) >= 0.0).all()
    assert still.stamp_s == 5.0


def test_it_matters() -> None:
    """The same scan taken as if the robot had stood is wrong by decimetres."""
    start = Pose2()
    poses = drive(start, 0.2, 0.0, 1.0)
    skewed = scan_along(poses, Pose2())
    expected_m = wall_ranges_m(np.zeros((360, 3)), skewed.bearings_rad)
    assert np.abs(skewed.ranges_m - expected_m).max() > 0.3


def test_a_standing_robot_changes_nothing() -> None:
    start = Pose2(0.3, -0.2, 1.0)
    poses = drive(start, 0.0, 0.0, 0.0)
    scan = scan_along(poses, Pose2(0.1, 0.0, 0.2))
    still = deskew(scan, poses, start.as_array(), Pose2(0.1, 0.0, 0.2))
    np.testing.assert_allclose(still.bearings_rad, scan.bearings_rad, atol=1e-12)
    np.testing.assert_allclose(still.ranges_m, scan.ranges_m, atol=1e-12)


def test_silent_beams_stay_silent_and_keep_their_direction() -> None:
    start = Pose2()
    poses = drive(start, 0.0, 0.0, 1.0)
    scan = scan_along(poses, Pose2())
    ranges_m = scan.ranges_m.copy()
    ranges_m[::7] = np.nan
    still = deskew(
        dataclasses.replace(scan, ranges_m=ranges_m), poses, start.as_array(), Pose2()
    )
    assert np.isnan(still.ranges_m).sum() == np.isnan(ranges_m).sum()
    turned = pose2.wrap_rad(BEARINGS_RAD + OFFSETS_S)[::7]
    np.testing.assert_allclose(
        np.sort(still.bearings_rad[np.isnan(still.ranges_m)]), np.sort(turned), atol=1e-9
    )


@pytest.mark.parametrize("beams", [0, 1])
def test_few_beams_are_no_special_case(beams: int) -> None:
    scan = LaserScan(
        stamp_s=0.0,
        bearings_rad=np.zeros(beams),
        ranges_m=np.ones(beams),
        range_std_m=np.ones(beams),
        beam_offsets_s=np.zeros(beams),
        range_max_m=6.0,
    )
    moved = deskew(scan, np.tile([1.0, 0.0, 0.0], (beams, 1)), np.zeros(3), Pose2())
    assert moved.ranges_m.tolist() == [2.0] * beams
