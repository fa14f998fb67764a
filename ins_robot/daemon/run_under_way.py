# SPDX-License-Identifier: MIT
"""What every run has, whoever carries the LRF: a state, a recording, scans, an end.

Everything that enters the core is written to the journal on the way in. Heavy steps go to the
survey worker (one thread); the loop keeps ticking meanwhile.
"""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor
from enum import StrEnum
from typing import Any, TypeVar

from ins_robot.config import Config
from ins_robot.core.run_core import RunCore, ScanJob
from ins_robot.daemon.orders import Place
from ins_robot.daemon.scan_taking import ScannerPower, ScanTaker
from ins_robot.errors import DeviceError, RobotError, StateError
from ins_robot.logs.journal import Journal
from ins_robot.mapping.zones import Zone, zones_as_json
from ins_robot.messages import ImuSample, LaserScan, Mark, WheelSample
from ins_robot.navigation.explorer import Drive

log = logging.getLogger(__name__)
T = TypeVar("T")

STANDING = (0.0, 0.0, 0.0)


class MissionState(StrEnum):
    """What a run is doing, or how it ended."""

    CALIBRATING = "calibrating"
    SCANNING = "scanning"
    THINKING = "thinking"
    DRIVING = "driving"
    WAITING = "waiting"  # for a person to carry the LRF
    COMPLETE = "complete"
    STOPPED = "stopped"
    FAILED = "failed"

    @property
    def is_over(self) -> bool:
        """True once the run has ended."""
        return self in (MissionState.COMPLETE, MissionState.STOPPED, MissionState.FAILED)


class RunUnderWay(ABC):
    """One exploration, from its first scan to its result; `_explore` is its method."""

    def __init__(
        self,
        name: str,
        config: Config,
        core: RunCore,
        scanner: Callable[[], ScannerPower],
        worker: Executor,
        journal: Journal,
    ) -> None:
        self.name = name
        self.core = core
        self.journal = journal
        self.state = MissionState.CALIBRATING
        self.reason = ""
        self.was_let_down = False  # a device failed it
        self.dropped_sweeps = 0
        self.goal: Drive | None = None
        self.paused_because = ""  # nobody asked for it
        self._config = config
        self._taker = ScanTaker(config.lrf, scanner)
        self._worker = worker
        self._clock = asyncio.get_running_loop().time
        self._go = asyncio.Event()
        self._go.set()
        self._group: asyncio.TaskGroup | None = None
        self._method: asyncio.Task[None] | None = None

    # ---------------------------------------------------------------- from start to end

    @abstractmethod
    async def _explore(self) -> None:
        """Scan, decide, move on, until `_end`."""

    def _halt(self) -> None:  # noqa: B027 - a run without motors has nothing to halt
        """Bring to a stand what moves."""

    async def explore(self) -> None:
        """Run to the end; `state` and `reason` tell which. Never raises a RobotError."""
        try:
            await self._run_method()
        except asyncio.CancelledError:
            self._end(MissionState.STOPPED, "ended from outside")
            raise
        finally:
            self._end(MissionState.FAILED, "internal error in the daemon; see its log")
            self._halt()
            await self._taker.switch_off()

    async def _run_method(self) -> None:
        try:
            async with asyncio.TaskGroup() as self._group:
                if not self.state.is_over:  # stopped before it began
                    self._method = self._group.create_task(self._explore(), name=self.name)
        except* RobotError as group:
            self.was_let_down = group.subgroup(DeviceError) is not None
            self._end(MissionState.FAILED, str(group.exceptions[0]))

    def stop(self, reason: str, *, failed: bool = False) -> None:
        """End the run where it is; `explore` returns soon after."""
        self._end(MissionState.FAILED if failed else MissionState.STOPPED, reason)
        if self._method is not None:
            self._method.cancel()

    def _end(self, state: MissionState, reason: str) -> None:
        """Set the final state; the first one stays."""
        if self.state.is_over:
            return
        self.state, self.reason = state, reason
        log.info("%s: %s: %s", self.name, state, reason)

    def _is_out_of_budget(self) -> bool:
        exploration = self._config.exploration
        if self.core.duration_s > exploration.max_time_s:
            self._end(
                MissionState.STOPPED,
                f"exploration.max_time_s = {exploration.max_time_s:g} s is used up",
            )
        return self.state.is_over

    # ---------------------------------------------------------------- scans and records

    @property
    def lrf_on_s(self) -> float:
        """How long the LRF's motor has been on."""
        return self._taker.on_s

    async def _take_whole(self) -> None:
        """The revolutions of one scan, from standing."""
        self.state = MissionState.SCANNING
        await self._taker.take(self._config.lrf.revolutions, self._begin_scan)

    def _node_scan(self) -> ScanJob:
        """What `_take_whole` took as a scan at a node, ready for the worker."""
        rpm = self._taker.set_rpm
        self._mark("node_scan", set_rpm=rpm)
        job = self.core.prepare_node_scan(rpm)
        self.state = MissionState.THINKING
        return job

    def _begin_scan(self) -> None:
        self._mark("scan_begin")
        self.core.begin_scan()

    def _record(self, revolution: LaserScan) -> None:
        self.journal.write(revolution)
        self.core.on_revolution(revolution)

    def _mark(self, kind: str, **payload: Any) -> Mark:
        mark = Mark(stamp_s=self._clock(), kind=kind, payload=payload)
        self.journal.write(mark)
        return mark

    def _in_worker(self, work: Callable[..., T], *args: Any) -> Awaitable[T]:
        # Shielded: what the journal holds is computed, even when nobody waits for it any more.
        job = asyncio.get_running_loop().run_in_executor(self._worker, work, *args)
        return asyncio.shield(job)

    def close_journal(self) -> None:
        """The last words, and all of it on the disk."""
        self._mark("end", state=str(self.state), reason=self.reason, lrf_on_s=self.lrf_on_s)
        self.journal.close()

    # ---------------------------------------------------------------- what comes in

    def on_imu(self, sample: ImuSample) -> None:  # noqa: B027 - not every base has one
        """A reading of gyro and compass."""

    def on_wheels(self, sample: WheelSample) -> tuple[float, float, float]:
        """A telemetry frame; the wheel speeds that answer it."""
        return STANDING

    def on_revolution(self, revolution: LaserScan) -> None:
        """A whole turn of the LRF."""
        if self._taker.is_steady(revolution) and self._taker.wants(revolution):
            self._record(revolution)

    # ---------------------------------------------------------------- the operator

    def forbid_from_start(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls of the run, before it begins."""
        self._mark("zones", zones=zones_as_json(zones))
        self.core.forbid(zones)

    async def forbid(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls from now on."""
        self._mark("zones", zones=zones_as_json(zones))
        await self._in_worker(self.core.forbid, zones)

    async def go_to(self, place_m: Place) -> None:
        """Drive to a place (x, y) of the map; StateError: it cannot be reached."""
        raise StateError("goto: nothing drives here: a person carries the LRF")

    def pause(self, because: str = "") -> None:
        """Stand, and stay where the method is."""
        self._go.clear()
        self.paused_because = because

    def resume(self) -> None:
        """Go on after `pause`."""
        self._go.set()
        self.paused_because = ""

    @property
    def is_paused(self) -> bool:
        """True between `pause` and `resume`."""
        return not self._go.is_set()
