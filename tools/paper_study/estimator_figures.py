# SPDX-License-Identifier: MIT
"""Figure 8, twice in the paper: similarity transform and particle filter on a curved way.

One recording with odometry as bad as an omni base's, replayed with each estimator.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ins_robot.config import Config
from ins_robot.core.run_core import RunCore
from ins_robot.estimation.fastslam_estimator import FastSlamEstimator
from ins_robot.estimation.protocol import FEATURE_REACH_M
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.features import features_of_scan
from ins_robot.simulation.truth import pose_errors
from ins_robot.simulation.world import World
from paper_study import drawing
from paper_study.recorded import Recorded, record, replayed, true_poses_at

OMNI_BASE = (
    "simulation.slip_std=0.05",
    "simulation.slip_bias_std=0.03",
    "simulation.gyro_scale_std=0.03",
)
"""Odometry as bad as an omni base's."""
BEARING_STD_RAD = math.radians(Config().slam.bearing_std_deg)
FEATURE_STD_MAX_M = 0.15
RADIUS_M = Config().robot.radius_m


def figure_8(out: Path) -> str:
    """Both figures of that number: figure8_similarity.png and figure8_particles.png."""
    recorded = record(out, "corridor_loop", 0, OMNI_BASE)
    odometry, _ = _replay(recorded, "odometry")
    similarity, _ = _replay(recorded, "similarity")
    fastslam, clouds = _replay(recorded, "fastslam")
    particle, _ = _replay(recorded, "particle")
    before = ("(a) before", odometry)
    _draw(recorded, [before, ("(b) similarity transform", similarity)], out, "similarity")
    _draw(
        recorded,
        [
            before,
            ("(b) FastSLAM on features", fastslam),
            ("(c) particle filter on whole scans", particle),
            ("(d) FastSLAM's particles, their mean", fastslam),
        ],
        out,
        "particles",
        clouds,
    )
    return f"{recorded.command}; its journal replayed with slam.estimator of each name"


def _replay(recorded: Recorded, estimator: str) -> tuple[RunCore, FloatArray]:
    """The finished core, and the particles (N, 3) after each scan at a node."""
    clouds = [np.zeros((0, 3))]
    for replay in replayed(recorded, [f"slam.estimator={estimator}"]):
        inside = replay.core.survey.slam._estimator  # noqa: SLF001 - no one else looks at clouds
        if isinstance(inside, FastSlamEstimator):
            clouds.append(inside._filter.poses.copy())  # noqa: SLF001
    return replay.core, np.concatenate(clouds)


def _draw(
    recorded: Recorded,
    panels: list[tuple[str, RunCore]],
    out: Path,
    name: str,
    clouds: FloatArray | None = None,
) -> None:
    world = World.builtin(recorded.world)
    start = world.start_pose(None, RADIUS_M)
    corners = drawing.world_points_m(world, start)
    _, true = recorded.truth()
    sides = np.ptp(corners, axis=0)
    rows = len(panels) // 2
    size = (8.4, rows * (4.2 * sides[1] / sides[0] + 0.4) + 0.4)
    figure, grid = plt.subplots(rows, 2, figsize=size)
    axes = list(grid.flat)
    for k, (ax, (title, core)) in enumerate(zip(axes, panels, strict=True)):
        drawing.show_walls(ax, world, start)
        _, way = core.corrected_trajectory()
        ax.plot(*true[:, :2].T, color=drawing.TRUE, lw=1.0, label="true way")
        has_cloud = clouds is not None and k == len(panels) - 1
        if has_cloud:
            ax.plot(*clouds[:, :2].T, ".", ms=1.2, color=drawing.OPEN_GAP, label="particles")
        else:
            _draw_features(ax, recorded, core)
        ax.plot(*way[:, :2].T, "--", color=drawing.ODOMETRY, lw=1.0, label="calculated way")
        off_m, _ = pose_errors(way, true_poses_at(recorded, core.trajectory.odometry()[0]))
        rms_m = math.sqrt(float(np.mean(off_m**2)))
        drawing.frame(ax, corners, f"{title}: {rms_m:.2f} m rms")
    drawing.scale_bar(axes[0], 2.0)
    labelled = [zip(*ax.get_legend_handles_labels(), strict=True) for ax in axes]
    handles = {label: handle for pairs in labelled for handle, label in pairs}
    figure.tight_layout(pad=0.6, rect=(0.0, 0.35 / size[1], 1.0, 1.0))
    figure.legend(
        handles.values(), handles.keys(), loc="lower center", ncols=5, fontsize=8, frameon=False
    )
    drawing.save(figure, out / f"figure8_{name}.png")


def _draw_features(ax: Axes, recorded: Recorded, core: RunCore) -> None:
    """Features of the scans at nodes, placed from the estimated and from the true poses."""
    nodes = core.survey.slam.nodes
    true = true_poses_at(recorded, np.array([node.stamp_s for node in nodes]))
    placed, right = [], []
    for node, pose in zip(nodes, true, strict=True):
        features = features_of_scan(node.scan, BEARING_STD_RAD, FEATURE_REACH_M)
        is_sure = np.trace(features.covariances, axis1=1, axis2=2) < FEATURE_STD_MAX_M**2
        placed.append(node.pose.apply(features.points_m[is_sure]))
        right.append(Pose2.from_array(pose).apply(features.points_m[is_sure]))
    for points, colour, size, label in (
        (right, drawing.TRUE, 4.5, "features from the true way"),
        (placed, drawing.ODOMETRY, 2.0, "features as placed"),
    ):
        ax.plot(*np.concatenate(points).T, "o", ms=size, color=colour, mew=0, label=label)
