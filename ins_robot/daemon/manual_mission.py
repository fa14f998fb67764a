# SPDX-License-Identifier: MIT
"""One run in which a person carries the LRF (the paper's emulation stage).

`next` names a place, the person carries the LRF there and says `here`, a scan is taken, and the
next place is named. A scan that fits nowhere in the map is refused: the person is sent back
towards the last one. A device that fails costs the scan, not the run.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor

from ins_robot.config import Config
from ins_robot.core.carried_core import CarriedCore
from ins_robot.core.survey import Decision
from ins_robot.daemon.orders import answer
from ins_robot.daemon.run_under_way import MissionState, RunUnderWay
from ins_robot.daemon.scan_taking import ScannerPower
from ins_robot.errors import DeviceError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import Journal
from ins_robot.navigation.decisions import NO_GAP
from ins_robot.navigation.explorer import Drive
from ins_robot.navigation.gap_ledger import FAILURES_MAX
from ins_robot.navigation.retreat import Retreat

log = logging.getLogger(__name__)

Order = tuple[Callable[[], Awaitable[None]], asyncio.Future[None]]


class ManualMission(RunUnderWay):
    """Waits for a person's orders and carries them out one by one."""

    core: CarriedCore

    def __init__(
        self,
        name: str,
        config: Config,
        core: CarriedCore,
        scanner: Callable[[], ScannerPower],
        worker: Executor,
        journal: Journal,
    ) -> None:
        super().__init__(name, config, core, scanner, worker, journal)
        self.state = MissionState.WAITING
        self._orders: asyncio.Queue[Order] = asyncio.Queue()
        self._retreat: Retreat | None = None

    async def here(self) -> None:
        """Scan where the LRF was put down; returns when the next place is known.

        Raises
        ------
        StateError
            When the scan fits nowhere, or the run does not wait for it.
        DeviceError
            When no scan came; the run goes on waiting.
        """
        await self._order(self._scan_here)

    async def skip(self) -> None:
        """The place named cannot be reached by a person: name another."""
        if self.goal is None or self.goal.gap_id == NO_GAP:
            raise StateError(
                "no place to skip: `ins-robot next` asks for a scan that nothing can replace"
            )
        await self._order(self._give_up)

    async def _order(self, work: Callable[[], Awaitable[None]]) -> None:
        if self.is_paused:
            raise StateError("the run is paused: `ins-robot resume` first")
        if self.state is not MissionState.WAITING:
            raise StateError(f"the run is {self.state}: wait until it names the next place")
        self.state = MissionState.THINKING  # taken: a second order is refused
        done = asyncio.get_running_loop().create_future()
        self._orders.put_nowait((work, done))
        await done

    async def _explore(self) -> None:
        while not self._is_out_of_budget():
            self.state = MissionState.WAITING
            work, done = await self._orders.get()
            try:
                await work()
            except (StateError, DeviceError) as error:
                log.warning("%s: %s", self.name, error)
                answer(done, error)
            else:
                answer(done, None)
            finally:
                answer(done, StateError(f"the run has ended: {self.reason or 'see the log'}"))

    async def _scan_here(self) -> None:
        place = Pose2() if self.goal is None else self.goal.place
        mark = self._mark("put_down", pose=[place.x_m, place.y_m, place.heading_rad])
        self.core.put_down(mark.stamp_s, place)
        await self._take_whole()
        outcome = await self._in_worker(self.core.compute, self._node_scan())
        if outcome.decision is None:
            assert outcome.misfit is not None
            raise StateError(self._send_back(outcome.misfit.why))
        self._take(outcome.decision)

    async def _give_up(self) -> None:
        """Another place: one that is named a second time is given up a second time."""
        refused = self.goal
        pose, why = self.core.pose, "a person cannot get there"
        for _ in range(FAILURES_MAX):
            assert refused is not None
            self._mark("give_up", why=why, pose=[pose.x_m, pose.y_m, pose.heading_rad])
            self._take(await self._in_worker(self.core.give_up, self.goal, why, pose))
            goal = self.goal
            if goal is None or goal.gap_id == NO_GAP or goal.place != refused.place:
                return

    def _take(self, decision: Decision) -> None:
        self._retreat = None
        if isinstance(decision, Drive):
            self.goal = decision
            log.info("%s: %s", self.name, decision.reason)
            return
        self.goal = None
        ended = MissionState.COMPLETE if decision.is_complete else MissionState.STOPPED
        self._end(ended, decision.reason)

    def _send_back(self, misfit: str) -> str:
        """Make a place nearer to the last one that is known the goal; what to tell the person.

        Half of the way back first: what fits there leads on, the last place is known already.
        """
        nodes = self.core.survey.slam.nodes
        if not nodes:
            return (
                f"the scan shows almost nothing ({misfit}): uncover the LRF, step back and try "
                "again"
            )
        node = nodes[-1]
        assert self.goal is not None
        why = (
            f"the scan here fits nowhere for certain ({misfit}); if the LRF still stands on "
            f"node {node.id}, carry it as told; else go back towards node {node.id} and try "
            "again"
        )
        self._retreat = self._retreat or Retreat(self.goal.path, node.pose)
        self.goal = Drive(
            path=self._retreat.next_leg(), node_id=node.id, gap_id=NO_GAP, reason=why
        )
        return why
