# SPDX-License-Identifier: MIT
"""The way back: half of the rest at a time, along the path, ending at its start."""

import numpy as np

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.retreat import Retreat


def test_legs_halve_the_way_and_end_at_the_start() -> None:
    path = PlannedPath(
        points_m=np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]), headings_rad=np.full(3, 1.0)
    )
    start = Pose2(0.05, 0.0, -1.0)
    retreat = Retreat(path, start)
    legs = [retreat.next_leg() for _ in range(5)]
    ends = [tuple(leg.points_m[-1]) for leg in legs]
    assert ends == [(2.0, 0.0), (1.0, 0.0), (0.5, 0.0), (0.05, 0.0), (0.05, 0.0)]
    assert tuple(legs[0].points_m[0]) == (2.0, 2.0)
    assert [leg.headings_rad[-1] for leg in legs] == [1.0, 1.0, 1.0, -1.0, -1.0]
