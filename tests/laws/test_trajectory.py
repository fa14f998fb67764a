# SPDX-License-Identifier: MIT
"""Laws of the corrected trajectory: it follows the anchors, in whatever frames."""

import threading

import numpy as np
import pytest

from ins_robot.core.trajectory import Anchor, TrajectoryRecorder
from ins_robot.geometry.angles import wrap_rad
from ins_robot.geometry.pose2 import Pose2


def drive(count=200, seed=0):
    """A winding way with a stop in it, and a recorder that holds it."""
    rng = np.random.default_rng(seed)
    pose, poses = Pose2(), []
    recorder = TrajectoryRecorder()
    for i in range(count):
        poses.append(pose)
        recorder.add(100.0 + 0.1 * i, pose)
        if not 80 <= i < 95:
            pose = pose @ Pose2(0.05, 0.0, float(rng.normal(0.0, 0.1)))
    return recorder, poses


def anchors_at(indices, poses, corrections):
    return [
        Anchor(
            stamp_s=100.0 + 0.1 * i,
            odom_from_base=poses[i],
            map_from_base=correction @ poses[i],
        )
        for i, correction in zip(indices, corrections, strict=True)
    ]


def corrections(count, seed=1):
    rng = np.random.default_rng(seed)
    return [Pose2(*rng.normal(0.0, 0.2, 3)) for _ in range(count)]


def assert_same(a, b):
    np.testing.assert_allclose(a[:, :2], b[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_rad(a[:, 2] - b[:, 2]), 0.0, atol=1e-9)


def as_array(poses):
    return np.array([p.as_array() for p in poses])


def test_without_anchors_it_is_the_odometry():
    recorder, poses = drive()
    stamps_s, corrected = recorder.corrected([])
    assert len(recorder) == len(stamps_s) == 200
    assert_same(corrected, as_array(poses))


def test_it_passes_through_every_anchor():
    recorder, poses = drive()
    indices = [3, 40, 79, 120, 199]
    anchors = anchors_at(indices, poses, corrections(5))
    _, corrected = recorder.corrected(anchors[::-1])
    assert_same(corrected[indices], as_array([a.map_from_base for a in anchors]))


def test_outside_the_anchors_the_nearest_correction_holds():
    recorder, poses = drive()
    first, last = corrections(2)
    _, corrected = recorder.corrected(anchors_at([50, 150], poses, [first, last]))
    assert_same(corrected[:50], as_array([first @ p for p in poses[:50]]))
    assert_same(corrected[150:], as_array([last @ p for p in poses[150:]]))


def test_equal_corrections_move_the_whole_way_rigidly():
    recorder, poses = drive()
    correction = Pose2(3.0, -2.0, 2.8)
    _, corrected = recorder.corrected(anchors_at([10, 60, 190], poses, [correction] * 3))
    assert_same(corrected, as_array([correction @ p for p in poses]))


def test_moving_the_map_moves_the_answer():
    recorder, poses = drive()
    given = anchors_at([10, 60, 190], poses, corrections(3))
    motion = Pose2(-7.0, 4.0, 3.0)
    moved = [
        Anchor(
            stamp_s=a.stamp_s,
            odom_from_base=a.odom_from_base,
            map_from_base=motion @ a.map_from_base,
        )
        for a in given
    ]
    expected = [motion @ Pose2.from_array(p) for p in recorder.corrected(given)[1]]
    assert_same(recorder.corrected(moved)[1], as_array(expected))


def test_the_choice_of_the_odom_frame_does_not_matter():
    recorder, poses = drive()
    given = anchors_at([10, 60, 190], poses, corrections(3))
    other = Pose2(50.0, -80.0, 1.0)
    elsewhere = TrajectoryRecorder()
    for i, pose in enumerate(poses):
        elsewhere.add(100.0 + 0.1 * i, other @ pose)
    moved = [
        Anchor(
            stamp_s=a.stamp_s,
            odom_from_base=other @ a.odom_from_base,
            map_from_base=a.map_from_base,
        )
        for a in given
    ]
    assert_same(elsewhere.corrected(moved)[1], recorder.corrected(given)[1])


def test_standing_still_is_not_driving():
    recorder, poses = drive()
    _, corrected = recorder.corrected(anchors_at([70, 110], poses, corrections(2)))
    assert_same(corrected[80:95], np.repeat(corrected[80:81], 15, axis=0))


def test_corrections_take_the_short_way_round():
    recorder, poses = drive()
    _, corrected = recorder.corrected(
        anchors_at([0, 199], poses, [Pose2(0, 0, 3.1), Pose2(0, 0, -3.1)])
    )
    turned = wrap_rad(corrected[:, 2] - as_array(poses)[:, 2])
    assert np.all(np.abs(turned) > 3.09)


def test_an_anchor_between_two_records_is_respected():
    recorder = TrajectoryRecorder()
    for i in range(3):
        recorder.add(float(i), Pose2(float(i), 0.0, 0.0))
    shifted = [
        Anchor(stamp_s=s, odom_from_base=Pose2(s), map_from_base=Pose2(s, y))
        for s, y in ((0.5, 0.0), (1.5, 1.0))
    ]
    assert recorder.corrected(shifted)[1][:, 1] == pytest.approx([0.0, 0.5, 1.0])


def test_time_that_goes_back_is_refused():
    recorder = TrajectoryRecorder()
    recorder.add(1.0, Pose2())
    recorder.add(1.0, Pose2(1.0))
    with pytest.raises(ValueError, match="after"):
        recorder.add(0.999, Pose2())


def test_a_trajectory_may_grow_while_another_thread_reads_it() -> None:
    recorder = TrajectoryRecorder()
    for i in range(100_000):
        recorder.add(0.1 * i, Pose2())
    is_over = threading.Event()

    def read() -> None:
        while not is_over.is_set():
            recorder.odometry()

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for i in range(20_000):
            recorder.add(1e6 + i, Pose2())
    finally:
        is_over.set()
        reader.join()
    assert len(recorder) == 120_000
