# SPDX-License-Identifier: MIT
"""One decision's view of the world: the map so far and a pose in, ground and edges out.

Made once a decision, because everything in it is asked for every gap: what is unseen, where
the robot can go, what it costs. It may begin with what is near, and be widened on demand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.grid_window import GridWindow
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
SIGHT_M = 4.5  # beyond the ways that are looked for the map is looked at so far
ALIGN_CELLS = 24  # coarser cells of 2, 6 and 8 are the same on a part of the map and on all
CUT_CELLS = 3  # where it is cut, what is seen and unseen is told so much farther in
NEAR_M = 0.5  # barren edges this near to newly opened ground are looked at afresh


@dataclass(slots=True, kw_only=True)
class Scene:
    """What a decision looks at.

    Attributes
    ----------
    map : OccupancyGrid
        All of it; `grid` is the part around the robot that is looked at.
    reach_m : float
        Ways no dearer than this are known; inf: all, on all of the map.
    looks_on_the_way : bool
        The LRF is always on.
    limits : callable
        `is_allowed` and `is_wanted` of a grid.
    driven_m : callable
        (N, 2) where the robot's centre has been, densely: all within a box, and more.
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
    map: OccupancyGrid
    body: BodyRules
    limits: Callable[[OccupancyGrid], tuple[BoolArray | None, BoolArray | None]]
    driven_m: Callable[[FloatArray, FloatArray], FloatArray]
    barren: BarrenEdges
    edge_min_m: float
    reach_m: float
    looks_on_the_way: bool = False
    grid: OccupancyGrid = field(init=False)
    is_allowed: BoolArray | None = field(init=False)
    is_wanted: BoolArray | None = field(init=False)
    terrain: Terrain = field(init=False)
    unseen: Unseen = field(init=False)
    targets: dict[tuple[int, int], FloatArray] = field(default_factory=dict)
    is_listed: bool = False
    has_adopted: bool = False
    has_squeezed: bool = False
    known_outlook: Outlook | None = None

    def __post_init__(self) -> None:
        self._look()

    def widen(self, reach_m: float | None = None) -> bool:
        """Look twice as far around, or as far as told; whether there was more."""
        wanted_m = 2.0 * self.reach_m if reach_m is None else reach_m
        if wanted_m <= self.reach_m:
            return False
        self.reach_m, self.known_outlook = wanted_m, None
        self._look()
        return True

    def holds(self, point_m: FloatArray, around_m: float) -> bool:
        """Whether all of the map so near to a point (2,) is looked at."""
        if math.isinf(self.reach_m):
            return True
        cells = self.grid.cells(point_m + around_m * np.array([[-1.0, -1.0], [1.0, 1.0]]))
        return bool(self.grid.contains(cells).all())

    def _look(self) -> None:
        """What is unseen, where the robot can go, and what it costs: one wave."""
        self.grid, is_inner = self._around()
        self.is_allowed, self.is_wanted = self.limits(self.grid)
        wanted = self.is_wanted
        if is_inner is not None:
            wanted = is_inner if wanted is None else is_inner & wanted
        self.unseen = survey_unseen(self.grid, self.edge_min_m, self.barren, wanted)
        low_m, high_m = (self.grid.metres(np.array(cell)) for cell in ((0, 0), self.grid.shape))
        odd = driven_cells(self.grid, self.driven_m(low_m, high_m), self.body)
        self.terrain = survey_terrain(
            self.grid, self.pose, self.body, self.is_allowed, odd, limit_m=self.reach_m
        )

    def _around(self) -> tuple[OccupancyGrid, BoolArray | None]:
        """Cells within reach and sight, and which are not where the map is cut; None: all."""
        resolution, size = self.map.resolution_m, self.map.shape
        here = self.map.cells(np.array([self.pose.x_m, self.pose.y_m]))
        most = 2.0 * max(size) * resolution
        reach = math.ceil((min(self.reach_m, most) + SIGHT_M) / resolution)
        low, high = np.clip(here - reach, 0, size), np.clip(here + reach + 1, 0, size)
        low -= low % ALIGN_CELLS
        if ((low == 0) & (high == size)).all() or (low == high).any():
            self.reach_m = math.inf
            return self.map, None
        cut = math.ceil(self.edge_min_m / resolution) + CUT_CELLS
        rows, cols = (np.arange(low[axis], high[axis]) for axis in (0, 1))
        is_inner = [
            ((low[axis] == 0) | (line >= low[axis] + cut))
            & ((high[axis] == size[axis]) | (line < high[axis] - cut))
            for axis, line in ((0, rows), (1, cols))
        ]
        (top, left), (bottom, right) = low.tolist(), high.tolist()
        grid = GridWindow(self.map, (slice(top, bottom), slice(left, right)))
        return grid, is_inner[0][:, None] & is_inner[1]

    def outlook(self, range_m: float, vain: BarrenEdges, graph: NodeGraph) -> Outlook:
        """What a strategy that chooses places sees of it; the same one until it changes."""
        if self.known_outlook is None:
            self.known_outlook = self._outlook(range_m, vain, graph)
        return self.known_outlook

    def _outlook(self, range_m: float, vain: BarrenEdges, graph: NodeGraph) -> Outlook:
        def wider(reach_m: float) -> Outlook:
            self.widen(reach_m)
            return self.outlook(range_m, vain, graph)

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
            looks_on_the_way=self.looks_on_the_way,
            limit_m=self.reach_m,
            wider=wider if math.isfinite(self.reach_m) else None,
        )

    def _looks(self, graph: NodeGraph) -> PastLooks:
        """The scans of all nodes."""
        origin, resolution = np.array(self.grid.origin_m), self.grid.resolution_m
        poses, sectors = graph.poses(), graph.sectors()
        return PastLooks(
            cells=((poses[:, :2] - origin) / resolution)[:, ::-1],
            towards_rad=poses[:, 2] + sectors[:, 0],
            half_rad=sectors[:, 1],
        )

    def squeeze(self) -> bool:
        """Price the ground again, with narrow passages and quiet ground; whether any opened."""
        if self.has_squeezed:
            return False
        self.widen(math.inf)
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
        afresh = self.barren.where_opened(self.grid, near)
        if afresh is not None:
            self.barren = afresh
            self.unseen = survey_unseen(self.grid, self.edge_min_m, afresh, self.is_wanted)
        return True
