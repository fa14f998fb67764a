# SPDX-License-Identifier: MIT
"""How a run ends: why in, the way home out, then the end itself.

The way home is tried a few times. A robot that comes home with everything explored looks once
more from there, unless its exploring had to end.
"""

from __future__ import annotations

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.bounds import Bounds
from ins_robot.navigation.decisions import Ending
from ins_robot.navigation.node_graph import NodeGraph
from ins_robot.navigation.reach import Reach
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.trips import AT_HOME_M, TRIES, is_at_home, trip


class WayHome:
    """Remembers why the run ends, from then on.

    Attributes
    ----------
    ending : Ending or None
        What ends the run at home; None while there is something to explore.
    is_final : bool
        Time, way or battery are used up: no more looks.
    """

    def __init__(self, graph: NodeGraph, bounds: Bounds, *, is_wanted: bool) -> None:
        self._graph, self._bounds, self._is_wanted = graph, bounds, is_wanted
        self.ending: Ending | None = None
        self.is_final = False
        self._tries = 0

    def looks_again(self, pose: Pose2) -> bool:
        """At home with everything explored: whether the robot explores on; asked once."""
        if self.ending is None or not self.ending.is_complete or self.is_final:
            return False
        if not self._is_home(pose):
            return False
        self.ending, self._tries = None, 0
        return True

    def step(self, scene: Scene, ending: Ending) -> PlannedPath | str:
        """The way home, or the end: its reason, which says so when home is not reached."""
        self.ending = ending
        if not self._is_wanted or self._is_home(scene.pose):
            return ending.reason
        self._tries += 1
        if self._tries > TRIES:
            return f"{ending.reason}; home was not reached"
        home = self._graph.nodes[0]
        path = trip(scene, home.position_m, home.pose.heading_rad)
        if path is None:
            _, why = Reach(scene, self._bounds, home.pose).why_not(home.position_m)
            return f"{ending.reason}; home is out of reach: {why}"
        away_m = scene.pose.distance_m(home.pose)
        if path.length_m <= AT_HOME_M < away_m:  # as near as it gets
            why = f"something stands too near, {away_m:.2f} m before it"
            return f"{ending.reason}; home was not reached: {why}"
        return path

    def _is_home(self, pose: Pose2) -> bool:
        return is_at_home(pose, self._graph.nodes[0].pose)
