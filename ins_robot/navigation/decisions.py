# SPDX-License-Identifier: MIT
"""What the explorer answers: where to drive next, or that it has finished and what was left."""

from __future__ import annotations

from dataclasses import dataclass

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.gaps import GapState
from ins_robot.navigation.leftovers import Leftover, leftovers
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.scene import Scene

NO_GAP = -1  # the drive is for no gap: home, an errand, a step back


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Drive along the path, then scan there: for a gap of a node, and why that one.

    `home_m` is the way home from where the path begins; None: no way is known.
    """

    path: PlannedPath
    node_id: int
    gap_id: int
    reason: str
    home_m: float | None = None

    @property
    def place(self) -> Pose2:
        """Where the path ends and the scan is taken, map_from_base."""
        x_m, y_m = self.path.points_m[-1]
        return Pose2(float(x_m), float(y_m), float(self.path.headings_rad[-1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftGap:
    """A gap that was left, and why."""

    node_id: int
    gap_id: int
    centroid_m: tuple[float, float]
    width_m: float
    state: str
    why: str


@dataclass(frozen=True, slots=True)
class Ending:
    """Why exploring ends; is_complete is False when a limit ended it."""

    reason: str
    is_complete: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """Nothing left to drive to; `is_complete` is False when a limit ended it.

    `left` are the gaps that were not explored, `unseen` the edges of the seen part of the map.
    """

    reason: str
    left: tuple[LeftGap, ...]
    unseen: tuple[Leftover, ...] = ()
    is_complete: bool = True


def finished(
    scene: Scene, graph: NodeGraph, bounds: Bounds, ending: Ending, reason: str
) -> Finished:
    """The end of a run, `reason` in full, with all that is left on the map as it is now."""
    if ending.is_complete:
        scene.squeeze()  # narrow passages were tried before it was called complete
    unfinished = None if ending.is_complete else ending.reason
    return Finished(
        reason=reason,
        left=_left_gaps(graph),
        unseen=leftovers(scene, graph, bounds, unfinished=unfinished),
        is_complete=ending.is_complete,
    )


def _left_gaps(graph: NodeGraph) -> tuple[LeftGap, ...]:
    """All gaps that are not explored."""
    return tuple(
        LeftGap(
            node_id=node.id,
            gap_id=gap.id,
            centroid_m=(float(node.centroid_m(gap)[0]), float(node.centroid_m(gap)[1])),
            width_m=gap.width_m,
            state=str(gap.state),
            why=gap.why,
        )
        for node, gap in graph.gaps()
        if gap.state is not GapState.EXPLORED
    )
