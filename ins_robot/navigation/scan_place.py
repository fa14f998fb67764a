# SPDX-License-Identifier: MIT
"""Where to scan a chosen gap from, and whether a scan there is worth it.

The robot goes to the gap's centroid; where the ground about it has been seen meanwhile, on to
what is still unseen beyond it (15 % less way, a quarter fewer scans on seven worlds). A scan
that can show hardly anything, or was taken already, adds nothing. A gap without a worthwhile
place gets its state here, with the reason; so every decision ends.
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.navigation.gaps import Gap, GapKind, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.unseen import STRIKES
from ins_robot.navigation.viewpoint import Look, Viewpoint, near_viewpoint, peeks

GAIN_MIN_M2 = 0.15  # a scan that can show less adds nothing
SAME_PLACE_M = 0.12  # a scan this near to an earlier one shows the same
LOOKED_SHARE = 0.5  # of the targets, that an earlier scan from there was turned to


class ScanPlaces:
    """Chooses places; remembers those that were refused."""

    def __init__(
        self,
        graph: NodeGraph,
        *,
        sector_half_rad: float,
        range_m: float,
        must_gain: bool,
    ) -> None:
        self._graph = graph
        self._half_rad, self._range_m = sector_half_rad, range_m
        self._must_gain = must_gain
        self._refused_m: list[FloatArray] = []

    def refuse(self, place_m: FloatArray) -> None:
        """A place (2,) could not be reached: another one is better next time."""
        self._refused_m.append(place_m)

    def choose(self, scene: Scene, node: Node, gap: Gap) -> Viewpoint | None:
        """A place from which a scan shows something new; None, and the gap says why."""
        targets = scene.targets[node.index, gap.id]
        away = targets - node.centroid_m(gap)
        look = Look(
            anchor_m=targets[int(np.hypot(away[:, 0], away[:, 1]).argmin())],
            outward=node.outward(gap),
            targets_m=targets,
            used_m=np.array([*self._graph.positions_m(), *self._refused_m]),
        )
        opaque = scene.unseen.is_opaque
        near = near_viewpoint(scene.terrain, opaque, look)
        if near is not None and self._is_worth(scene, near, look):
            return near
        looks_in = near is not None
        if gap.kind is GapKind.EDGE:  # from afar as well: no other gap leads there
            for peek in peeks(
                scene.terrain, opaque, look, lambda view: self._gain(scene, view)
            ):
                if self._is_worth(scene, peek, look):
                    return peek
                looks_in = True
            if looks_in:
                scene.barren.strike(look.targets_m, STRIKES)
        if looks_in:
            gap.set(GapState.EXPLORED, "adds nothing: a scan there would show no more")
        else:
            gap.set(GapState.UNREACHABLE, "no reachable place looks into it")
        return None

    def _is_worth(self, scene: Scene, view: Viewpoint, look: Look) -> bool:
        """Whether a scan there may show something that no earlier one did."""
        if not self._must_gain:
            return True
        if self._was_scanned_from(scene, view, look.targets_m):
            return False
        return self._gain(scene, view) * scene.grid.resolution_m**2 >= GAIN_MIN_M2

    def _gain(self, scene: Scene, view: Viewpoint) -> int:
        """Unseen cells that a scan may show."""
        return scene.unseen.gain_cells(
            view.cell, view.heading_rad, self._half_rad, self._range_m
        )

    def _was_scanned_from(self, scene: Scene, view: Viewpoint, targets_m: FloatArray) -> bool:
        """Whether a node has looked towards the targets from the same place."""
        away = self._graph.positions_m() - scene.grid.metres(np.array(view.cell))
        for index in np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) < SAME_PLACE_M):
            node = self._graph.nodes[int(index)]
            ahead = targets_m - node.position_m
            bearings = np.arctan2(ahead[:, 1], ahead[:, 0]) - node.pose.heading_rad
            centre_rad, half_rad = node.sector
            looked = np.abs(wrap_rad(bearings - centre_rad)) < half_rad
            if looked.mean() > LOOKED_SHARE:
                return True
        return False
