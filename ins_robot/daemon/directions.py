# SPDX-License-Identifier: MIT
"""Where a run goes next, as JSON values for `ins-robot next` and as marks on the map.

Bearing and turn are told from where the LRF stands and looks now, positive to the left.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from ins_robot.core.run_result import RunResult
from ins_robot.daemon.run_under_way import RunUnderWay
from ins_robot.logs.run_directory import picture_of
from ins_robot.mapping.map_picture import GoalMark, MapPicture
from ins_robot.navigation.explorer import Drive


def directions(run: RunUnderWay) -> dict[str, Any]:
    """What `next` answers; `goal` is null where there is none yet, or no more."""
    told: dict[str, Any] = {
        "run": run.name,
        "state": "paused" if run.is_paused and not run.state.is_over else str(run.state),
        "reason": run.reason,
        "goal": None,
    }
    goal = run.goal
    if goal is None or run.state.is_over:
        return told
    here, place = run.core.pose, goal.place
    there = here.between(place)
    return told | {
        "reason": goal.reason,
        "goal": {"x_m": place.x_m, "y_m": place.y_m, "heading_rad": place.heading_rad},
        "bearing_rad": math.atan2(there.y_m, there.x_m),
        "distance_m": math.hypot(there.x_m, there.y_m),
        "way_m": goal.path.length_m,
        "turn_rad": there.heading_rad,
    }


def picture_with(goal: Drive | None, result: RunResult) -> MapPicture:
    """The run's picture, nodes numbered, with its goal and the way there."""
    mark = None if goal is None else GoalMark(path_m=goal.path.points_m, place=goal.place)
    node_ids = [node["id"] for node in result.graph["nodes"]]
    return replace(picture_of(result), goal=mark, node_ids=node_ids)
