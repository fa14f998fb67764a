# SPDX-License-Identifier: MIT
"""One decision's view of the world: the map so far and a pose in, ground and edges out.

Made once a decision, because everything in it is asked for every gap: what is unseen, where the
robot can go, what it costs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.occupancy_grid import OccupancyGrid
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.outlook import Outlook, PastLooks
from ins_robot.navigation.squeeze import find_squeezes
from ins_robot.navigation.terrain import (
    BodyRules,
    BoolArray,
    Terrain,
    driven_cells,
    survey_terrain,
)
from ins_robot.navigation.unseen import BarrenEdges, Unseen, survey_unseen

GAIN_MIN_M2 = 0.1  # expected of a scan for which a strategy may choose a place
REACH_M = 0.15  # a place whose body is this near to an edge is at it
NEAR_M = 0.5  # barren edges this near to newly opened ground get another chance


@dataclass(slots=True, kw_only=True)
class Scene:
    """What a decision looks at.

    Attributes
    ----------
    is_allowed, is_wanted : (H, W) bool or None
        Where the robot may be, and what is worth exploring; None: everywhere.
    targets : dict
        For each gap worth driving to, by (node index, gap id): (T, 2) what it should show.
    is_listed, has_adopted, has_squeezed : bool
        What is done once a decision has been done.
    known_outlook : Outlook or None
        None: to be made anew, because ground or edges have changed.
    """

    pose: Pose2
    grid: OccupancyGrid
    body: BodyRules
    is_allowed: BoolArray | None
    is_wanted: BoolArray | None
    terrain: Terrain
    unseen: Unseen
    barren: BarrenEdges
    edge_min_m: float
    targets: dict[tuple[int, int], FloatArray] = field(default_factory=dict)
    is_listed: bool = False
    has_adopted: bool = False
    has_squeezed: bool = False
    known_outlook: Outlook | None = None

    def outlook(self, range_m: float, vain: BarrenEdges, graph: NodeGraph) -> Outlook:
        """What a strategy that chooses places sees of it; the same one until it changes."""
        if self.known_outlook is None:
            self.known_outlook = self._outlook(range_m, vain, graph)
        return self.known_outlook

    def _outlook(self, range_m: float, vain: BarrenEdges, graph: NodeGraph) -> Outlook:
        unseen, resolution = self.unseen, self.grid.resolution_m
        kept = np.flatnonzero(~vain.mask(unseen.ahead_m))
        order = kept[np.argsort(unseen.edge_of[kept], kind="stable")]
        cuts = np.flatnonzero(np.diff(unseen.edge_of[order])) + 1
        edges = np.split(unseen.cells[order], cuts) if len(order) else []
        return Outlook(
            resolution_m=resolution,
            range_m=range_m,
            is_unseen=unseen.is_unseen,
            is_opaque=unseen.is_opaque,
            factor=self.terrain.factor,
            cost_m=self.terrain.cost_m,
            before=self.terrain.before,
            here=self.terrain.start_cell,
            edges=tuple(edges),
            gain_min_m2=GAIN_MIN_M2,
            looks=self._looks(graph),
            reach_cells=math.ceil((self.body.radius_m + REACH_M) / resolution),
        )

    def _looks(self, graph: NodeGraph) -> PastLooks:
        """The scans of all nodes."""
        origin, resolution = np.array(self.grid.origin_m), self.grid.resolution_m
        sectors = np.array([node.sector for node in graph.nodes])
        headings = np.array([node.pose.heading_rad for node in graph.nodes])
        return PastLooks(
            cells=((graph.positions_m() - origin) / resolution)[:, ::-1],
            towards_rad=headings + sectors[:, 0],
            half_rad=sectors[:, 1],
        )

    def squeeze(self) -> bool:
        """Price the ground again, with narrow passages and quiet ground; whether any opened."""
        if self.has_squeezed:
            return False
        self.has_squeezed = True
        self.known_outlook = None
        before = self.terrain.is_reachable
        odd = find_squeezes(self.grid, self.body, self.unseen.is_unseen)
        odd = self.terrain.odd.joined(odd)
        self.terrain = survey_terrain(
            self.grid, self.pose, self.body, self.is_allowed, odd, takes_quiet=True
        )
        opened = self.terrain.is_reachable & ~before
        if not opened.any():
            return False
        near = distance_transform_edt(~opened, sampling=self.grid.resolution_m) <= NEAR_M
        if self.barren.forgive(self.grid, near):
            self.unseen = survey_unseen(self.grid, self.edge_min_m, self.barren, self.is_wanted)
        return True


def look_around(
    grid: OccupancyGrid,
    pose: Pose2,
    body: BodyRules,
    *,
    is_allowed: BoolArray | None,
    is_wanted: BoolArray | None,
    edge_min_m: float,
    barren: BarrenEdges,
    driven_m: FloatArray,
) -> Scene:
    """What is unseen, where the robot can go, and what it costs: one wave."""
    unseen = survey_unseen(grid, edge_min_m, barren, is_wanted)
    odd = driven_cells(grid, driven_m, body)
    terrain = survey_terrain(grid, pose, body, is_allowed, odd)
    return Scene(
        pose=pose,
        grid=grid,
        body=body,
        is_allowed=is_allowed,
        is_wanted=is_wanted,
        terrain=terrain,
        unseen=unseen,
        barren=barren,
        edge_min_m=edge_min_m,
    )
