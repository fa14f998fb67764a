# SPDX-License-Identifier: MIT
"""The occupancy grid of a node map, drawn from its scans and drawn again when nodes moved.

New nodes are added as they come. When a correction moved nodes visibly, the grid is drawn again
from all scans in the order they were taken, which is what a clamped log-odds grid means.
"""

from __future__ import annotations

import numpy as np

from ins_robot.config import MapConfig
from ins_robot.estimation.node_map import NodeMap
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid

VISIBLE_SHARE = 0.25  # of a cell: smaller corrections of a node are not redrawn
LEVER_M = 3.0  # a turn of a node moves what it saw this far away


class RenderedMap:
    """Keeps a grid in step with the nodes."""

    def __init__(self, config: MapConfig, base_from_lrf: Pose2, range_trusted_m: float) -> None:
        self._config = config
        self._base_from_lrf = base_from_lrf
        self._range_trusted_m = range_trusted_m
        self._grid = OccupancyGrid(config.resolution_m, config)
        self._drawn_at = np.zeros((0, 3))

    def grid(self, nodes: NodeMap) -> OccupancyGrid:
        """The grid, brought up to date."""
        poses = nodes.graph.poses
        drawn = len(self._drawn_at)
        if self._moved(poses[:drawn]):
            self._grid = OccupancyGrid(self._config.resolution_m, self._config)
            drawn = 0
        for node in range(drawn, len(nodes)):
            map_from_lrf = Pose2.from_array(poses[node]) @ self._base_from_lrf
            self._grid.integrate(nodes.scans[node], map_from_lrf, self._range_trusted_m)
        if drawn < len(nodes):
            self._drawn_at = np.concatenate([self._drawn_at[:drawn], poses[drawn:]])
        return self._grid

    def _moved(self, poses: FloatArray) -> bool:
        off = np.abs(poses - self._drawn_at)
        off[:, 2] = np.minimum(off[:, 2], 2.0 * np.pi - off[:, 2]) * LEVER_M
        return bool((off > VISIBLE_SHARE * self._config.resolution_m).any())
