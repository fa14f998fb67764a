# SPDX-License-Identifier: MIT
"""Trajectories of one log on one picture, each laid rigidly on the first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from slam_study.trajectory import Trajectory, rigid_onto

GAP_S = 5.0


def draw_trajectories(title: str, by_name: Mapping[str, Trajectory], path: Path) -> None:
    """Write the picture."""
    figure, axes = plt.subplots(figsize=(9.0, 9.0))
    first: Trajectory | None = None
    for name, trajectory in by_name.items():
        points_m = trajectory.poses[:, :2]
        if first is None:
            first = trajectory
        else:
            onto, _, has = first.at(trajectory.stamps_s, 0.05, GAP_S)
            if has.sum() > 1:
                points_m = _laid(points_m, has, onto[has, :2])
        axes.plot(points_m[:, 0], points_m[:, 1], linewidth=0.8, label=name)
    axes.set_aspect("equal")
    axes.set_title(title)
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")
    axes.legend()
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _laid(points_m: np.ndarray, has: np.ndarray, onto_m: np.ndarray) -> np.ndarray:
    """All of the points (N, 2), moved as fits those that have a partner."""
    laid, _ = rigid_onto(points_m[has], onto_m)
    here, there = (p[:, 0] + 1j * p[:, 1] for p in (points_m[has], laid))
    turn = np.vdot(here - here.mean(), there - there.mean())
    whole = points_m[:, 0] + 1j * points_m[:, 1] - here.mean()
    whole = whole * turn / max(abs(turn), 1e-12) + there.mean()
    return np.column_stack([whole.real, whole.imag])
