# SPDX-License-Identifier: MIT
"""What scores trajectories gives known figures for known faults."""

from pathlib import Path

import numpy as np
import pytest
from slam_study.ablations import configured, is_drawn
from slam_study.cases import to_and_fro
from slam_study.scores import Camera, Relations
from slam_study.trajectory import Trajectory, rigid_onto
from slam_study.walls import distances_to_walls_m

from ins_robot.errors import ConfigError
from ins_robot.geometry.pose2 import Pose2, between, compose
from ins_robot.logs.sensor_log import LogRecord, OdometryNoise, SensorLog

STAMPS_S = np.arange(20.0)
POSES = np.column_stack([np.sin(STAMPS_S), 0.3 * STAMPS_S, 0.1 * STAMPS_S - 1.0])


def empty_log(stamps_s=(0.0,)):
    return SensorLog(
        kind="none",
        records=[LogRecord(stamp_s=s, odom_from_base=Pose2(s)) for s in stamps_s],
        base_from_lrf=Pose2(),
        motion_model=OdometryNoise(),
        range_trusted_m=1.0,
        robot_radius_m=0.1,
    )


def relations_file(directory: Path) -> None:
    rows = []
    for a, b in ((0, 5), (3, 17), (8, 9), (19, 2)):
        x, y, yaw = between(POSES[a], POSES[b])
        rows.append(f"{a}.0 {b}.0 {x:.9f} {y:.9f} 0 0 0 {yaw:.9f}")
    (directory / "r").write_text("\n".join(rows) + "\n")


def test_relations_see_no_fault_in_a_trajectory_moved_as_a_whole(tmp_path):
    relations_file(tmp_path)
    moved = compose([7.0, -3.0, 2.0], POSES)
    score = Relations("r")(Trajectory.of(STAMPS_S, moved), empty_log(), tmp_path)
    assert score["error_m"] == pytest.approx(0.0, abs=1e-7)
    assert score["error_deg"] == pytest.approx(0.0, abs=1e-5)
    assert (score["matched"], score["relations"]) == (4, 4)


def test_a_fault_of_one_pose_is_the_fault_of_its_relations(tmp_path):
    relations_file(tmp_path)
    bent = POSES.copy()
    bent[17] = compose(bent[17], [0.03, 0.04, np.radians(2.0)])
    score = Relations("r")(Trajectory.of(STAMPS_S, bent), empty_log(), tmp_path)
    assert score["error_m"] == pytest.approx(0.05 / 4, abs=1e-7)
    assert score["error_deg"] == pytest.approx(2.0 / 4, abs=1e-5)


def test_stamps_are_met_within_the_tolerance_or_between_two_poses():
    trajectory = Trajectory.of(np.array([2.0, 0.0]), np.array([[2.0, 0, 3.0], [0, 0, -3.0]]))
    poses, keys, has = trajectory.at(np.array([0.01, 1.0, 1.5, 2.5, -1.0]), 0.02, 3.0)
    assert has.tolist() == [True, True, True, False, False]
    np.testing.assert_allclose(poses[:3, 0], [0.0, 1.0, 1.5])
    assert abs(poses[1, 2]) == pytest.approx(np.pi)  # the short way round
    assert len(set(keys[:3])) == 3
    assert not trajectory.at(np.array([1.0]), 0.02, 1.5)[2].any()


def test_both_ends_at_one_pose_are_no_relation(tmp_path):
    (tmp_path / "r").write_text("0.001 0.002 0 0 0 0 0 0\n")
    trajectory = Trajectory.of(STAMPS_S, POSES)
    assert Relations("r")(trajectory, empty_log(), tmp_path) == {"matched": 0.0}


def test_what_is_tracked_behind_the_centre_is_moved_ahead():
    moved = Trajectory.of(np.zeros(1), np.array([[1.0, 2.0, np.pi / 2]]), ahead_m=0.5)
    np.testing.assert_allclose(moved.poses[0, :2], [1.0, 2.5])


def test_the_camera_does_not_mind_where_its_frame_is(tmp_path):
    turned = compose([1.0, 2.0, 0.7], POSES)
    lines = [
        f"P {1e3 * s:.3f} {1e3 * p[0]:.6f} {1e3 * p[1]:.6f}"
        for s, p in zip(STAMPS_S, turned, strict=True)
    ]
    (tmp_path / "p").write_text("\n".join(lines))
    score = Camera("p")(Trajectory.of(STAMPS_S, POSES), empty_log(), tmp_path)
    assert score["error_m"] == pytest.approx(0.0, abs=1e-6)
    assert score["scale"] == pytest.approx(1.0)
    laid, scale = rigid_onto(POSES[:, :2], 2.0 * POSES[:, :2])
    assert scale == pytest.approx(2.0)
    assert np.ptp(laid[:, 0]) == pytest.approx(np.ptp(POSES[:, 0]))


def walls(rng, offset_m, noise_m=0.004):
    """(N, 2) returns and normals of a corner, one of its walls seen once more, off by that."""
    along = rng.uniform(0.0, 4.0, (3, 1500))
    noise = rng.normal(0.0, noise_m, (3, 1500))
    points = [
        np.stack([along[0], noise[0]], axis=-1),
        np.stack([noise[1], along[1]], axis=-1),
        np.stack([along[2], noise[2] + offset_m], axis=-1),
    ]
    normals = np.repeat([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]], 1500, axis=0)
    return np.concatenate(points), normals


def test_a_wall_seen_twice_at_two_places_is_one_thick_wall():
    rng = np.random.default_rng(0)
    thin, thick = (distances_to_walls_m(*walls(rng, offset)) for offset in (0.0, 0.1))
    assert len(thin) > 4300
    assert np.percentile(thin, 90) == pytest.approx(1.645 * 0.004, rel=0.15)
    assert np.percentile(thick, 90) > 0.04


def test_there_and_back_is_one_drive_without_a_jump():
    log = to_and_fro(empty_log((5.0, 6.0, 8.0)), 3)
    stamps_s = np.array([record.stamp_s for record in log.records])
    places = [record.odom_from_base.x_m for record in log.records]
    assert places == [5.0, 6.0, 8.0, 8.0, 6.0, 5.0, 5.0, 6.0, 8.0]
    np.testing.assert_allclose(stamps_s, [5, 6, 8, 8.5, 10.5, 11.5, 12, 13, 15])


def test_an_estimator_is_named_with_its_options():
    config = configured("no-loops+slam.particles=7", 3)
    assert (config.slam.estimator, config.slam.particles, config.slam.seed) == (
        "no-loops",
        7,
        3,
    )
    assert is_drawn("particle+slam.particles=7")
    assert not is_drawn("odometry")
    with pytest.raises(ConfigError, match="estimator 'x'"):
        configured("x", 0)
