# SPDX-License-Identifier: MIT
"""The occupancy grid of a node map, drawn from its scans; where nodes moved, drawn again.

Scans are drawn in the order they were taken, which is what a clamped log-odds grid means.
Consecutive nodes make a strip, whose evidence is kept as one sum; when a correction moves nodes
visibly, only their strips are drawn again, and only the cells under them laid together anew.
Before which wall silence ends is decided when a scan is first drawn, and goes with it.
"""

from __future__ import annotations

import numpy as np

from ins_robot.config import MapConfig
from ins_robot.estimation.node_map import NodeMap
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.evidence_sums import UNIT, EvidenceSums
from ins_robot.mapping.occupancy_grid import BoolArray, OccupancyGrid

VISIBLE_SHARE = 0.25  # of a cell: smaller corrections of a node are not redrawn
LEVER_M = 3.0  # a turn of a node moves what it saw this far away
STRIP_NODES = 24  # more: more to draw for a node that moved; fewer: more sums to keep


class RenderedMap:
    """Keeps a grid in step with the nodes."""

    def __init__(self, config: MapConfig, base_from_lrf: Pose2, range_trusted_m: float) -> None:
        self._config = config
        self._base_from_lrf = base_from_lrf
        self._range_trusted_m = range_trusted_m
        self._grid = OccupancyGrid(config.resolution_m, config)
        self._drawn_at = np.zeros((0, 3))
        self._wall_m: list[FloatArray | None] = []  # of each drawn node
        self._strips: list[EvidenceSums | None] = []  # None: not needed so far

    def grid(self, nodes: NodeMap) -> OccupancyGrid:
        """The grid, brought up to date."""
        poses, drawn = nodes.graph.poses, len(self._drawn_at)
        moved = self._moved(poses[:drawn])
        if moved.any():
            self._redraw(nodes, np.unique(np.flatnonzero(moved) // STRIP_NODES).tolist())
        is_following = len(poses) - drawn <= STRIP_NODES
        for node in range(drawn, len(poses)):
            footprint = self._grid.integrate(
                nodes.scans[node], self._at(poses[node]), self._range_trusted_m
            )
            self._wall_m.append(footprint.silent_wall_m)
            if node % STRIP_NODES == 0:
                self._strips.append(EvidenceSums(self._config) if is_following else None)
            strip = self._strips[-1]
            if strip is not None:
                strip.add(footprint)
        if drawn < len(poses):
            self._drawn_at = np.concatenate([self._drawn_at, poses[drawn:]])
        return self._grid

    def _moved(self, poses: FloatArray) -> BoolArray:
        off = np.abs(poses - self._drawn_at)
        off[:, 2] = np.minimum(off[:, 2], 2.0 * np.pi - off[:, 2]) * LEVER_M
        return np.asarray((off > VISIBLE_SHARE * self._config.resolution_m).any(axis=1))

    def _at(self, pose: FloatArray) -> Pose2:
        return Pose2.from_array(pose) @ self._base_from_lrf

    def _redraw(self, nodes: NodeMap, changed: list[int]) -> None:
        """Draw those strips anew, and lay the cells that were or are under them together."""
        strips = [
            self._summed(nodes, k) if strip is None else strip
            for k, strip in enumerate(self._strips)
        ]
        under = [strips[k] for k in changed]
        for k in changed:
            part = slice(k * STRIP_NODES, min((k + 1) * STRIP_NODES, len(self._drawn_at)))
            self._drawn_at[part] = nodes.graph.poses[part]
            strips[k] = self._summed(nodes, k)
        under += [strips[k] for k in changed]
        grid = OccupancyGrid(self._config.resolution_m, self._config)
        for strip in strips:
            grid.make_room(strip.corner, strip.end)
        grid.take_over(self._grid)
        low = (min(s.corner[0] for s in under), min(s.corner[1] for s in under))
        high = (max(s.end[0] for s in under), max(s.end[1] for s in under))
        units = np.zeros((high[0] - low[0], high[1] - low[1]), np.int16)
        is_quiet = np.zeros(units.shape, bool)
        for strip in strips:
            strip.lay_on(units, is_quiet, low)
        grid.put(low, units * np.float32(UNIT), is_quiet)
        for scan, pose in zip(nodes.scans, self._drawn_at, strict=False):
            grid.keep_readings(scan, self._at(pose))
        self._grid = grid
        self._strips = list(strips)

    def _summed(self, nodes: NodeMap, strip: int) -> EvidenceSums:
        """The evidence of a strip's nodes where they are drawn."""
        sums = EvidenceSums(self._config)
        first = strip * STRIP_NODES
        for node, pose in enumerate(self._drawn_at[first : first + STRIP_NODES], start=first):
            sums.add(
                self._grid.footprint_of(
                    nodes.scans[node],
                    self._at(pose),
                    self._range_trusted_m,
                    self._wall_m[node],
                )
            )
        return sums
