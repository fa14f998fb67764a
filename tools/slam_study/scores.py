# SPDX-License-Identifier: MIT
"""What a trajectory is worth on a log: by relations, by a camera, by how thin the walls are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.geometry.pose2 import Pose2, between
from ins_robot.logs.sensor_log import SensorLog
from ins_robot.mapping.surfels import surfels_of_scan
from slam_study.trajectory import Trajectory, rigid_onto
from slam_study.walls import distances_to_walls_m

Score = dict[str, float]
"""`error_m`, perhaps `error_deg`, and what else is worth telling."""

Scorer = Callable[[Trajectory, SensorLog, Path], Score]
"""Trajectory, its log, and the directory of the data."""

REFERENCE_GAP_S = 2.0
BEARING_STD_RAD = np.radians(0.5)


@dataclass(frozen=True)
class Relations:
    """Kuemmerle et al. (2009): mean of |relation^-1 (+) estimated relation| over a file."""

    file: str
    tolerance_s: float = 0.02
    gap_s: float = 0.0

    def __call__(self, trajectory: Trajectory, log: SensorLog, data: Path) -> Score:
        table = np.loadtxt(data / self.file, usecols=(0, 1, 2, 3, 7), ndmin=2)
        first, first_key, has_first = trajectory.at(table[:, 0], self.tolerance_s, self.gap_s)
        second, second_key, has_second = trajectory.at(
            table[:, 1], self.tolerance_s, self.gap_s
        )
        used = has_first & has_second & (first_key != second_key)
        if not used.any():
            return {"matched": 0.0}
        off = between(table[used, 2:], between(first[used], second[used]))
        return {
            "error_m": float(np.hypot(off[:, 0], off[:, 1]).mean()),
            "error_deg": float(np.degrees(np.abs(off[:, 2])).mean()),
            "matched": float(used.sum()),
            "relations": float(len(table)),
        }


@dataclass(frozen=True)
class Camera:
    """RMS distance from reference positions (`P time_ms x_mm y_mm`) after rigid alignment."""

    file: str

    def __call__(self, trajectory: Trajectory, log: SensorLog, data: Path) -> Score:
        lines = (data / self.file).read_text(encoding="ascii").split("\n")
        rows = [line.split()[1:4] for line in lines if line.startswith("P")]
        table = np.array(rows, dtype=np.float64) * 1e-3
        poses, _, has = trajectory.at(table[:, 0], 0.0, REFERENCE_GAP_S)
        if not has.any():
            return {"matched": 0.0}
        laid_m, scale = rigid_onto(poses[has, :2], table[has, 1:])
        off_m = np.hypot(*(laid_m - table[has, 1:]).T)
        return {
            "error_m": float(np.sqrt((off_m**2).mean())),
            "matched": float(has.sum()),
            "scale": scale,
        }


@dataclass(frozen=True)
class ThinWalls:
    """90th percentile of the distance from returns to the wall segments they belong to.

    Used are returns from flat surfaces: chair legs before a wall are no error of the map.
    """

    def __call__(self, trajectory: Trajectory, log: SensorLog, data: Path) -> Score:
        scans = [record.scan for record in log.records if record.scan is not None]
        stamps_s = np.array([scan.stamp_s for scan in scans])
        poses, _, has = trajectory.at(stamps_s, 1e-3, REFERENCE_GAP_S)
        if not has.any():
            return {"matched": 0.0}
        points_m, normals = [], []
        for k in np.flatnonzero(has):
            seen = surfels_of_scan(scans[k], BEARING_STD_RAD, log.range_trusted_m)
            walls = seen.take(seen.is_flat).at(Pose2.from_array(poses[k]) @ log.base_from_lrf)
            points_m.append(walls.points_m)
            normals.append(walls.normals)
        everything = np.concatenate(points_m)
        distances_m = distances_to_walls_m(everything, np.concatenate(normals))
        return {
            "error_m": float(np.percentile(distances_m, 90.0)),
            "matched": float(len(distances_m)),
            "share_on_walls": len(distances_m) / len(everything),
        }
