# SPDX-License-Identifier: MIT
"""A trajectory as every system writes it, looked up by stamp, laid on another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.logs.run_directory import read_tum

Found = tuple[FloatArray, FloatArray, np.ndarray]


@dataclass(frozen=True)
class Trajectory:
    """Poses (N, 3) at stamps (N,), in the order of time."""

    stamps_s: FloatArray
    poses: FloatArray

    @staticmethod
    def of(stamps_s: FloatArray, poses: FloatArray, ahead_m: float = 0.0) -> Trajectory:
        """`ahead_m`: what is wanted sits that far ahead of what was tracked."""
        order = np.argsort(stamps_s, kind="stable")
        moved = poses[order]
        moved[:, 0] += ahead_m * np.cos(moved[:, 2])
        moved[:, 1] += ahead_m * np.sin(moved[:, 2])
        return Trajectory(stamps_s[order], moved)

    @staticmethod
    def read(path: Path, ahead_m: float = 0.0) -> Trajectory:
        return Trajectory.of(*read_tum(path), ahead_m)

    def at(self, stamps_s: FloatArray, tolerance_s: float, gap_s: float) -> Found:
        """Poses (M, 3) at stamps (M,), what each was taken from (M,), and if there is one.

        The nearest pose within the tolerance; else, between two poses at most `gap_s` apart,
        what lies between them. Two answers from one and the same pose have the same key.
        """
        times = self.stamps_s
        after = np.searchsorted(times, stamps_s, side="left")
        low, high = np.clip(after - 1, 0, None), np.clip(after, None, len(times) - 1)
        off_low, off_high = np.abs(times[low] - stamps_s), np.abs(times[high] - stamps_s)
        nearest = np.where(off_low <= off_high, low, high)
        is_near = np.minimum(off_low, off_high) <= tolerance_s
        pause_s = times[high] - times[low]
        is_between = (after > 0) & (after < len(times)) & (pause_s <= gap_s) & (gap_s > 0.0)
        share = (stamps_s - times[low]) / np.where(pause_s > 0.0, pause_s, 1.0)
        step = self.poses[high] - self.poses[low]
        step[:, 2] = wrap_rad(step[:, 2])
        between = self.poses[low] + share[:, None] * step
        poses = np.where(is_near[:, None], self.poses[nearest], between)
        keys = np.where(is_near, nearest, stamps_s + len(times))
        return poses, keys.astype(np.float64), is_near | is_between


def rigid_onto(points_m: FloatArray, onto_m: FloatArray) -> tuple[FloatArray, float]:
    """Points (N, 2) turned and shifted onto others, and the scale that would fit best."""
    here, there = (p[:, 0] + 1j * p[:, 1] for p in (points_m, onto_m))
    here_0, there_0 = here - here.mean(), there - there.mean()
    product = np.vdot(here_0, there_0)
    turned = here_0 * product / max(abs(product), 1e-12) + there.mean()
    scale = abs(product) / max(float(np.vdot(here_0, here_0).real), 1e-12)
    return np.column_stack([turned.real, turned.imag]), scale
