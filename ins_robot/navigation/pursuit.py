# SPDX-License-Identifier: MIT
"""What the robot drives for, and what it has learned of goals tried in vain.

Aims in; struck edges, refused places and gaps that wait out. A goal that fails waits, is tried
once more, and is then given up, until a second chance from another place.
"""

from __future__ import annotations

from dataclasses import dataclass

from ins_robot.errors import StateError
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.decisions import Drive
from ins_robot.navigation.driven_ways import DrivenWays
from ins_robot.navigation.gap_ledger import FAILURES_MAX
from ins_robot.navigation.gaps import Gap, GapState
from ins_robot.navigation.node_graph import Node, NodeGraph
from ins_robot.navigation.scan_place import ScanPlaces
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.second_chances import SecondChances
from ins_robot.navigation.terrain import Terrain
from ins_robot.navigation.unseen import BarrenEdges

IN_VAIN_SHARE = 0.5  # a scan that leaves more of what it was to show unseen was in vain


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What one drive is for.

    Attributes
    ----------
    drive : Drive
    node : Node
        The gap's.
    gap : Gap or None
        None for a trip.
    targets_m : (N, 2) float64
        What the scan there is to show, map frame.
    memory : BarrenEdges
        Where it counts when it is in vain.
    is_retraced : bool
        Over the nodes of the way back.
    heeds_looks : bool
        By a strategy that counts tries itself.
    """

    drive: Drive
    node: Node
    gap: Gap | None
    targets_m: FloatArray
    memory: BarrenEdges
    is_retraced: bool = False
    heeds_looks: bool = False


class Pursuit:
    """The target under way and the last one scanned, and what became of all before.

    Parameters
    ----------
    barren, vain : BarrenEdges
        Edges that scans for gaps, and for places, did not move.
    """

    def __init__(
        self,
        graph: NodeGraph,
        places: ScanPlaces,
        ways: DrivenWays,
        barren: BarrenEdges,
        vain: BarrenEdges,
    ) -> None:
        self._places, self._ways = places, ways
        self._chances = SecondChances(graph, barren, vain)
        self._under_way: Target | None = None
        self._scanned: Target | None = None

    def set_out(self, target: Target) -> None:
        """The robot is sent there."""
        self._under_way = target

    def arrived(self, node: Node) -> None:
        """The drive has ended in a new node, and its gap has been looked into."""
        self._scanned, self._under_way = self._under_way, None
        target = self._scanned
        if target is None:
            return
        came_by = target.node if target.is_retraced else None
        self._ways.arrived(node, target.drive.path.points_m, came_by)
        if target.gap is not None and target.gap.is_open:
            target.gap.set(GapState.EXPLORED, f"scanned at its place: node {node.id}")

    def stands_at(self, pose: Pose2) -> None:
        """Where the robot is when it decides anew, on its way too."""
        if self._under_way is not None:
            self._ways.gave_up(self._under_way.drive.path.points_m)
        self._ways.stands_at(pose)
        self._chances.stands_at(pose)

    def interrupted(self, at: Pose2) -> None:
        """Somebody picked the robot up there; what it drove for is left open."""
        self.stands_at(at)
        self._ways.interrupted()
        self._under_way = None

    def failed(self, drive: Drive, why: str) -> None:
        """The goal of the last drive was not reached."""
        target, self._under_way = self._under_way, None
        if target is None or target.drive is not drive:
            raise StateError("explorer: report_failure() of what is not the last decision")
        self._ways.gave_up(drive.path.points_m)
        self._refuse(target, why)

    def stalled(self, pose: Pose2) -> None:
        """Goals came and went and the map does not grow: this one waits."""
        self._refuse(self._under_way or self._scanned, "nothing new came of it")
        self._chances.stands_at(pose)

    def learn_from_last_scan(self, scene: Scene) -> None:
        """What a scan was to show and did not counts as tried: nothing is scanned for ever."""
        target, self._scanned = self._scanned, None
        if target is None or target.gap is None or target.heeds_looks:
            return
        cells = scene.grid.cells(target.targets_m)
        still = ~scene.grid.contains(cells)
        still[~still] = scene.unseen.is_unseen[cells[~still, 0], cells[~still, 1]]
        if still.mean() > IN_VAIN_SHARE:
            target.memory.strike(target.targets_m[still])

    def reopen(self, pose: Pose2) -> bool:
        """Open again what was given up elsewhere than here, each once; whether any was."""
        return self._chances.reopen(pose)

    def step_back(self, terrain: Terrain) -> Node | None:
        """Where to try once more what was given up right here; asked once."""
        return self._chances.step_back(terrain)

    def _refuse(self, target: Target | None, why: str) -> None:
        """What a drive was for waits, and after two of these is given up."""
        if target is None or target.gap is None:
            return
        gap = target.gap
        self._places.refuse(target.drive.path.points_m[-1])
        target.memory.refuse(target.targets_m)
        self._chances.refused(target.node, gap, target.targets_m)
        gap.failures += 1
        gap.is_deferred = True
        if gap.failures >= FAILURES_MAX:
            gap.set(GapState.UNREACHABLE, f"given up after {gap.failures} tries: {why}")
