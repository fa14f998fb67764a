# SPDX-License-Identifier: MIT
"""What a place that a strategy chose is for: an aim in; a gap, and how to stand there, out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.navigation.gaps import Gap, GapState
from ins_robot.navigation.guard import gap_along
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.outlook import Aim
from ins_robot.navigation.scene import Scene

SAME_M = 0.1  # targets this near to one another are one
SAME_SHARE = 0.5  # an aim with more than this of its targets in common is the same again
HEADINGS = 36  # compared, where not all targets are in one look


@dataclass(frozen=True, slots=True, kw_only=True)
class AimGap:
    """A gap of the graph, (T, 2) what a scan should show of it, and where to face."""

    node: Node
    gap: Gap
    targets_m: FloatArray
    heading_rad: float


def gap_of_aim(
    scene: Scene,
    graph: NodeGraph,
    aim: Aim,
    sector_half_rad: float,
    before: Sequence[AimGap] = (),
) -> AimGap:
    """What a place is for becomes a gap of the nearest node, or is one of those `before`.

    So that what was aimed at in vain is known when it is aimed at again.
    """
    is_target = np.zeros(scene.grid.shape, bool)
    is_target[aim.targets[:, 0], aim.targets[:, 1]] = True
    cells = scene.unseen.cells
    index = np.flatnonzero(is_target[cells[:, 0], cells[:, 1]])
    targets_m = scene.unseen.ahead_m[index]
    not_shown = (old for old in reversed(before) if old.gap.state is not GapState.EXPLORED)
    same = next((old for old in not_shown if _is_same(targets_m, old)), None)
    if same is None:
        node, gap = gap_along(scene.unseen, graph, index)
    else:
        node, gap = same.node, same.gap
    ahead = targets_m - scene.grid.metres(np.array(aim.cell))
    heading_rad = facing_rad(np.arctan2(ahead[:, 1], ahead[:, 0]), sector_half_rad)
    return AimGap(node=node, gap=gap, targets_m=targets_m, heading_rad=heading_rad)


def _is_same(targets_m: FloatArray, old: AimGap) -> bool:
    """Whether an aim is at what an old one was at."""
    away_m, _ = cKDTree(old.targets_m).query(targets_m)
    return bool((away_m <= SAME_M).mean() > SAME_SHARE)


def facing_rad(bearings_rad: FloatArray, half_rad: float) -> float:
    """The heading with most of the bearings (T,) in sight; else, and first, their mean."""
    mean = np.arctan2(np.sin(bearings_rad).mean(), np.cos(bearings_rad).mean())
    headings = mean + 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
    off = np.abs(wrap_rad(bearings_rad[None] - headings[:, None]))
    return float(wrap_rad(headings[int((off < half_rad).sum(axis=1).argmax())]))
