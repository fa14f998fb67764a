# SPDX-License-Identifier: MIT
"""Where the robot is after a run, and drives on the run's map: `ins-robot goto` without a run.

The odometry goes on, so the robot still knows its place; nothing is recorded any more. Whoever
carries or pushes it loses that.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

from ins_robot.config import Config
from ins_robot.control.path_follower import Following
from ins_robot.core.run_core import RunCore
from ins_robot.daemon.mission import Mission
from ins_robot.daemon.orders import Place
from ins_robot.daemon.pilot import Pilot
from ins_robot.daemon.run_under_way import MissionState
from ins_robot.daemon.scan_taking import ScannerPower
from ins_robot.errors import StateError
from ins_robot.logs.journal_codec import Message
from ins_robot.navigation.explorer import Drive

TRIES = 4


class NoJournal:
    """Keeps nothing."""

    def write(self, message: Message) -> None:
        """Not kept."""

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing is open."""


class AfterRun(Mission):
    """Feeds an ended run's core, and drives to one place when `explore` is called."""

    def __init__(
        self,
        name: str,
        config: Config,
        core: RunCore,
        pilot: Pilot,
        scanner: Callable[[], ScannerPower],
        worker: Executor,
    ) -> None:
        super().__init__(name, config, core, pilot, scanner, worker, NoJournal())
        core.is_recorded = False
        self.place_m: Place = (0.0, 0.0)

    async def look_for_way(self, place_m: Place) -> None:
        """Whether a known way leads to a place; a StateError says why none does."""
        if self.core.survey.explorer.blindness.is_feared:  # as the run ended; it may see again
            try:
                await self._sweep()
            finally:
                await self._taker.switch_off()
        await self._in_worker(self.core.go_to, place_m, self.core.pose)

    async def _explore(self) -> None:
        self._hold()  # whoever drove before may have left the wheels held
        await self._look_out()  # all scans have been laid on one another since
        if self._taker.is_always_on:
            await self._taker.switch_on()
        where = f"{self.place_m[0]:g} {self.place_m[1]:g}"
        for _ in range(TRIES):
            self._orders.zones_changed = False  # the way is looked for on what is allowed now
            drive = await self._in_worker(self.core.go_to, self.place_m, self.core.pose)
            outcome = await self._drive(drive)
            await self._until_standing()
            await self._sweep()
            if outcome is Following.ARRIVED:
                self._end(MissionState.COMPLETE, f"arrived at {where}")
                return
        self._end(MissionState.STOPPED, f"goto {where}: the way is blocked")

    def _why_home(self, goal: Drive, driven_m: float = 0.0) -> str | None:
        """Never: time and way are the run's, and an empty battery ends anything."""
        return None

    async def go_to(self, place_m: Place) -> None:
        """One place at a time."""
        raise StateError("goto: the robot is on its way already; `ins-robot stop` ends that")
