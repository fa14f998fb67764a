# SPDX-License-Identifier: MIT
"""A place somebody named: a scene in, the way there out, for as long as it is worth trying."""

from __future__ import annotations

import math

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.scene import Scene
from ins_robot.navigation.trips import AT_HOME_M, TRIES, trip


class Errand:
    """One place (2,) of the map; named where the run began, it is home, facing as there."""

    def __init__(self, place_m: FloatArray, home: Pose2) -> None:
        self._place_m, self._heading_rad = place_m, None
        if math.hypot(place_m[0] - home.x_m, place_m[1] - home.y_m) <= AT_HOME_M:
            self._place_m, self._heading_rad = home.as_array()[:2], home.heading_rad
        self._tries = 0

    def path(self, scene: Scene) -> PlannedPath | None:
        """The way there; None: none is known, or it was tried often enough."""
        self._tries += 1
        return trip(scene, self._place_m, self._heading_rad) if self._tries <= TRIES else None
