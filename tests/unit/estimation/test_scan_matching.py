# SPDX-License-Identifier: MIT
"""What may be laid on what: surfaces correspond only when seen from the same side."""

import numpy as np
import pytest

from ins_robot.estimation.scan_matching import align, log_likelihoods
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.surfels import Surfels

PRIOR = np.diag([1.0, 1.0, 1.0])


def posts(viewer_x_m: float, wall_x_m: float) -> Surfels:
    """Edges of six door posts along a wall, as seen from one side of it."""
    points = np.stack([np.full(6, wall_x_m), np.linspace(-1.5, 1.5, 6)], axis=-1)
    towards = np.array([viewer_x_m, 0.0]) - points
    return Surfels(
        points_m=points,
        normals=towards / np.hypot(*towards.T)[:, None],
        is_flat=np.zeros(6, bool),
        std_m=np.full(6, 0.05),
        tilt_std_rad=np.zeros(6),
        is_lone=np.zeros(6, bool),
        sources=np.zeros(6, np.int64),
    )


def seen_at(pose: Pose2, surfels: Surfels) -> Surfels:
    return surfels.at(pose.inverse())


def test_edges_of_a_wall_seen_from_its_other_side_do_not_pull() -> None:
    """Through a wall of 0.15 m: its back edges are not the front edges, shifted."""
    field = LikelihoodField(posts(viewer_x_m=-2.0, wall_x_m=0.0))
    pose = Pose2(2.0, 0.0, 3.0)
    back = seen_at(pose, posts(viewer_x_m=2.0, wall_x_m=0.15))
    match = align(field, back, pose.as_array()[None], pose.as_array(), PRIOR)
    assert match.inliers == 0
    np.testing.assert_allclose(match.pose, pose.as_array(), atol=1e-9)


@pytest.mark.parametrize("viewer_y_m", [0.0, 1.5])
def test_edges_seen_from_the_same_side_do(viewer_y_m: float) -> None:
    field = LikelihoodField(posts(viewer_x_m=-2.0, wall_x_m=0.0))
    true = Pose2(-2.0, viewer_y_m, 0.0)
    front = seen_at(true, posts(viewer_x_m=-2.0, wall_x_m=0.0))
    start = true.as_array() + np.array([0.06, -0.05, 0.01])
    match = align(field, front, start[None], start, 1e-6 * PRIOR)
    assert match.inliers == 6
    np.testing.assert_allclose(match.pose, true.as_array(), atol=2e-3)


def test_a_pose_where_few_readings_fit_well_is_no_better_than_one_where_all_do() -> None:
    """Six posts 0.6 m apart: shifted by one, five of them fit as well as before."""
    field = LikelihoodField(posts(viewer_x_m=-2.0, wall_x_m=0.0))
    true = Pose2(-2.0, 0.0, 0.0)
    scan = seen_at(true, posts(viewer_x_m=-2.0, wall_x_m=0.0))
    poses = true.as_array() + np.array([[0.0, 0.0, 0.0], [0.01, 0.01, 0.0], [0.0, 0.6, 0.0]])
    right, near, shifted = log_likelihoods(field, scan, poses)
    assert right > near > shifted + 0.5
