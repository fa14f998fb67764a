# SPDX-License-Identifier: MIT
"""A simulated robot with all its devices, its daemon and a story that happens to it."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.config import load
from ins_robot.daemon.commands import DaemonCommands
from ins_robot.daemon.run_store import RunStore
from ins_robot.daemon.run_under_way import RunUnderWay
from ins_robot.daemon.runtime import Robot
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.harness import SimulatedRobot
from ins_robot.simulation.virtual_clock import VirtualTimeLoop
from ins_robot.simulation.world import World


@dataclass(frozen=True, kw_only=True)
class Live:
    """What a story may touch: the daemon's robot, the body it drives, the client's commands."""

    robot: Robot
    simulated: SimulatedRobot
    commands: DaemonCommands
    start: Pose2

    @property
    def true_place(self) -> Pose2:
        """Where the body is, in the frame of a map that begins at the start."""
        now_s = asyncio.get_running_loop().time()
        return self.start.between(
            Pose2.from_array(self.simulated.body.poses_at(np.array([now_s]))[0])
        )

    async def until(self, state: str) -> RunUnderWay:
        """The run, once it is in a state."""
        mission = self.robot.mission
        assert mission is not None
        while str(mission.state) != state:  # noqa: ASYNC110 - a state has no event
            await asyncio.sleep(0.1)
        return mission


async def live(
    story: Callable[[Live], Awaitable[None]],
    runs: Path,
    *,
    world: str = "open_room",
    overrides: tuple[str, ...] = (),
    timeout_s: float = 120.0,
) -> Robot:
    """The robot lives for as long as `story` takes; commands store their runs in `runs`."""
    config = load(None, list(overrides))
    place = World.find(world)
    clock = asyncio.get_running_loop().time
    start = place.start_pose(None, config.robot.radius_m)
    simulated = SimulatedRobot(config, place, start, 0, clock())
    connector = simulated.memory_connector(clock)
    robot = Robot(config, connector, annotate=simulated.annotate)
    commands = DaemonCommands(robot, RunStore(runs))

    async def direct() -> None:
        async with asyncio.timeout(timeout_s):
            await robot.pipeline.complete.wait()
            await story(Live(robot=robot, simulated=simulated, commands=commands, start=start))
        robot.supervisor.shut_down("the story is told")

    robot.supervisor.add_task("simulator", lambda: simulated.pump(connector))
    robot.supervisor.add_task("director", direct)
    await robot.serve()
    return robot


class SlowWorkers(VirtualTimeLoop):
    """Virtual time on which what a job of the survey worker gave comes `job_s` later."""

    job_s = 0.0

    def run_in_executor(self, executor, func, *args):
        """The job's result, not before its time."""
        done = super().run_in_executor(executor, func, *args)
        if self.job_s == 0.0 or getattr(executor, "_thread_name_prefix", "") != "survey":
            return done
        later = self.create_future()
        self.call_later(self.job_s, _hand_on, done, later)
        return later


def _hand_on(done: asyncio.Future, later: asyncio.Future) -> None:
    if later.cancelled():
        return
    if (error := done.exception()) is not None:
        later.set_exception(error)
    else:
        later.set_result(done.result())


def run_slow(main: Coroutine) -> None:
    """`run_virtual`; a story may set the running loop's `job_s`."""
    with asyncio.Runner(loop_factory=SlowWorkers) as runner:
        runner.run(main)
