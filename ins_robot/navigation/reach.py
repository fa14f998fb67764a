# SPDX-License-Identifier: MIT
"""Why a place cannot be driven to: a scene and a point in, a state and words for people out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.cell_states import KNOWN_LOG_ODDS, OCCUPIED_LOG_ODDS
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.gaps import GapState
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.terrain import Terrain, survey_terrain

THIN_M = 0.05  # a body this thin passes wherever the map is open at all
EDGE_M = 0.3  # the body keeps its radius, and this, from the unseen ground beyond an edge

Why = tuple[GapState, str]


class Reach:
    """One scene's answers; ground that is priced for them is priced once."""

    def __init__(self, scene: Scene, bounds: Bounds, start: Pose2) -> None:
        self._scene, self._bounds, self._start = scene, bounds, start
        near_m = scene.body.radius_m + EDGE_M
        self._near_cells = math.ceil(near_m / scene.grid.resolution_m)
        self._grounds: dict[str, Terrain] = {}

    def is_reachable(self, point_m: FloatArray) -> bool:
        """Whether a place so near to the point (2,) that it shows can be driven to."""
        return self._leads_to(self._scene.terrain, point_m)

    def why_not(self, point_m: FloatArray) -> Why:
        """Of a point (2,) that cannot be reached."""
        refusal = self._bounds.refusal(self._start, point_m)
        if refusal is not None:
            return refusal
        grid = self._scene.grid
        log_odds = float(grid.log_odds_at(point_m))
        if log_odds > OCCUPIED_LOG_ODDS:
            return GapState.UNREACHABLE, "a wall stands there"
        if log_odds >= -KNOWN_LOG_ODDS:
            return GapState.UNREACHABLE, "nobody has seen that place yet"
        if not self._bounds.are_open:
            if self._leads_to(self._ground("no zones"), point_m):
                return GapState.NO_GO, "a no-go zone or a virtual wall bars the way"
            if self._leads_to(self._ground("no limits"), point_m):
                return GapState.OUTSIDE, "the way there leads outside the boundary"
        if self._leads_to(self._ground("thin"), point_m):
            width_m = 2.0 * self._scene.body.radius_m
            return (
                GapState.TOO_NARROW,
                "the way there is too narrow, or not seen from near yet, "
                f"robot {width_m:.2f} m",
            )
        return GapState.UNREACHABLE, "no known way leads there"

    def _ground(self, kind: str) -> Terrain:
        """The ground as it would be without zones, without any limits, or for a thin body."""
        if kind not in self._grounds:
            scene, bounds, body = self._scene, self._bounds, self._scene.body
            allowed = None
            if kind == "no zones":
                allowed = bounds.without_zones().drivable_cells(
                    self._start, scene.grid, scene.pose
                )
            if kind == "thin":
                allowed = scene.is_allowed
                body = replace(body, radius_m=min(THIN_M, body.radius_m))
            self._grounds[kind] = survey_terrain(
                scene.grid, scene.pose, body, allowed, scene.terrain.odd
            )
        return self._grounds[kind]

    def _leads_to(self, terrain: Terrain, point_m: FloatArray) -> bool:
        return bool(np.isfinite(terrain.cost_near_m(point_m[None], self._near_cells)[0]))
