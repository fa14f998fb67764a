# SPDX-License-Identifier: MIT
"""What a finished (or running) run is, as values: the one input of everything that saves it.

The daemon, `simulate` and `replay` all fill a `RunResult`; `logs.run_directory` turns it into
the files of the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.map_files import GridView
from ins_robot.mapping.zones import Zone


class RunState(StrEnum):
    """How a run ended."""

    COMPLETE = "complete"
    STOPPED = "stopped"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """One run.

    Attributes
    ----------
    grid : GridView
        The map.
    stamps_s, map_from_base : (N,), (N, 3)
        The trajectory with all corrections known at the end; stamps do not go back.
    true_map_from_base : (N, 3) or None
        In simulation the true poses at the same stamps, in the same frame.
    graph : mapping
        JSON values for graph.json, as `navigation.explorer.Explorer.as_json` gives them:
        {"nodes": [{"id", "stamp_s", "x_m", "y_m", "heading_rad", "sector", "neighbours",
        "gaps": [{"centroid", "ends": [[x, y], [x, y]], "width_m", "state"}]}]}.
    path_length_m : float
        Way driven, by odometry.
    lrf_on_s : float
        How long the LRF's motor was on.
    slam_ms : sequence of float
        Computing time of each SLAM step.
    truth_metrics : mapping
        In simulation: coverage, wall_error_m, collisions, localization_rmse_m,
        heading_rmse_deg.
    notes : mapping
        Anything more for summary.json.
    zones : sequence of Zone
        No-go zones and virtual walls.
    limits_m : sequence of (N, 2)
        Closed lines around where the robot may be: boundary, radius.
    """

    name: str
    state: RunState
    reason: str
    grid: GridView
    stamps_s: FloatArray
    map_from_base: FloatArray
    graph: Mapping[str, Any]
    robot_radius_m: float
    duration_s: float
    path_length_m: float
    scans: int
    nodes: int
    loop_closures: int
    lrf_on_s: float
    ins_ms_total: float
    wall_time_s: float
    peak_rss_mb: float
    slam_ms: Sequence[float] = ()
    true_map_from_base: FloatArray | None = None
    truth_metrics: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)
    zones: Sequence[Zone] = ()
    limits_m: Sequence[FloatArray] = ()

    def summary(self) -> dict[str, Any]:
        """The content of summary.json."""
        slam_ms = np.asarray(self.slam_ms, dtype=np.float64)
        median, p95 = np.percentile(slam_ms, [50.0, 95.0]) if len(slam_ms) else (0.0, 0.0)
        return {
            "name": self.name,
            "state": str(self.state),
            "reason": self.reason,
            "duration_s": round(self.duration_s, 3),
            "path_length_m": round(self.path_length_m, 3),
            "scans": self.scans,
            "nodes": self.nodes,
            "loop_closures": self.loop_closures,
            "lrf_on_s": round(self.lrf_on_s, 3),
            "ins_ms_total": round(self.ins_ms_total, 3),
            "slam_ms_median": round(float(median), 3),
            "slam_ms_p95": round(float(p95), 3),
            "wall_time_s": round(self.wall_time_s, 3),
            "peak_rss_mb": round(self.peak_rss_mb, 1),
            **self.truth_metrics,
            **self.notes,
        }


def path_length_m(poses: FloatArray) -> float:
    """Length of the way through poses (N, 3)."""
    steps = np.diff(np.asarray(poses, dtype=np.float64)[:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())
