# SPDX-License-Identifier: MIT
"""The bench's robot in a world that changes: it stops before it would touch, and says so."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from exploring import RADIUS_M, Config, bench

from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.explorer import Drive, Explorer, Finished
from ins_robot.navigation.planner import dense_points_m
from ins_robot.simulation.world import World

STEP_M = 0.02


class CautiousRobot(bench.BenchRobot):
    """Stands still before what is not on its map; `solid` is what no beam shows, too."""

    solid: World | None = None

    def drive_as_far_as_it_goes(self, path: PlannedPath) -> bool:
        """Along the path; whether its end was reached."""
        dense = dense_points_m(path.points_m, STEP_M)
        points = self.start.apply(dense)
        world = self.solid or self.world
        room = np.array([world.clearance.nearest_wall(*p).distance_m for p in points])
        blocked = np.flatnonzero((room < RADIUS_M - bench.TOUCH_M) & (room < room[0]))
        if len(blocked) == 0:
            self.drive(path)
            return True
        last = dense[max(int(blocked[0]) - 1, 0)]
        self.path_m += STEP_M * max(int(blocked[0]) - 1, 0)
        self.pose = Pose2(float(last[0]), float(last[1]), self.pose.heading_rad)
        return False


@dataclass(slots=True)
class Story:
    """What happened."""

    robot: CautiousRobot
    explorer: Explorer
    grid: bench.OccupancyGrid
    decision: Drive | Finished | None = None
    drives: list[Drive] = field(default_factory=list)
    scans: int = 0
    failures: int = 0


def tell(
    world: World,
    start: Pose2,
    config: Config | None = None,
    change: Callable[[Story], World | None] = lambda story: None,
    decisions_max: int = 150,
) -> Story:
    """Explore to the end; `change` may put another world in place before each drive."""
    config = config or Config()
    robot = CautiousRobot(world, start, config.lrf, RADIUS_M)
    explorer = Explorer(config.exploration, config.robot, config.lrf)
    grid = bench.OccupancyGrid(config.map.resolution_m, config.map)
    story = Story(robot, explorer, grid)

    def scan(half_rad: float):
        seen = robot.scan(half_rad)
        grid.integrate(seen, robot.pose, config.lrf.range_trusted_m)
        return seen

    arrived = True
    for number in range(decisions_max):
        half_rad = np.pi if number == 0 else np.radians(config.lrf.sector_deg)
        seen = scan(half_rad)
        if arrived:
            explorer.observe(story.scans, float(number), robot.pose, seen, (0.0, half_rad))
            story.scans += 1
        else:
            story.failures += 1
            explorer.report_failure(story.decision, "blocked")
        story.decision = explorer.decide(robot.pose, grid)
        if isinstance(story.decision, Finished):
            return story
        story.drives.append(story.decision)
        robot.world = change(story) or robot.world
        arrived = robot.drive_as_far_as_it_goes(story.decision.path)
    raise AssertionError(f"no end after {decisions_max} decisions")
