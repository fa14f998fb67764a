# SPDX-License-Identifier: MIT
"""One run: stand, scan, decide, drive, until nothing is left to see.

Everything that enters the core is written to the journal on the way in. Heavy steps go to the
survey worker (one thread); the loop keeps ticking meanwhile.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Executor
from enum import StrEnum
from typing import Any, Protocol, TypeVar

from ins_robot.config import Config
from ins_robot.control.path_follower import Following
from ins_robot.core.run_core import RunCore, ScanJob, ScanOutcome
from ins_robot.core.survey import Decision
from ins_robot.daemon.pilot import Pilot
from ins_robot.errors import DeviceError, RobotError
from ins_robot.logs.journal import JournalWriter
from ins_robot.messages import ImuSample, LaserScan, Mark, WheelSample
from ins_robot.navigation.explorer import Drive

log = logging.getLogger(__name__)
T = TypeVar("T")

CALIBRATION_TIMEOUT_S = 60.0
WATCH_PERIOD_S = 0.2  # how often a drive looks at its pose uncertainty
ROOMY_M = 0.4  # with this much clearance `lrf.look_every_m` is taken as it is
CRAMPED_SHARE = 0.15  # and no less than this share of it among obstacles
DRIFT = 0.04  # of the way since the last look the pose may be off, with slipping wheels
TIGHT_M = 0.008  # what counts as clearance in the tightest place
MOTORS_GONE_S = 10.0  # without telemetry for so long a drive has ended, badly
RECONNECT_S = 3.0  # the supervisor has opened the LRF again by then, if it is there
SETTLE_S = 0.2  # from the last command to standing still


class MissionState(StrEnum):
    """What a run is doing, or how it ended."""

    CALIBRATING = "calibrating"
    SCANNING = "scanning"
    THINKING = "thinking"
    DRIVING = "driving"
    COMPLETE = "complete"
    STOPPED = "stopped"
    FAILED = "failed"

    @property
    def is_over(self) -> bool:
        """True once the run has ended."""
        return self in (MissionState.COMPLETE, MissionState.STOPPED, MissionState.FAILED)


class ScannerPower(Protocol):
    """The part of the LRF driver a mission commands."""

    @property
    def set_rpm(self) -> float:
        """The speed it is told to hold."""
        ...

    async def motor_on(self) -> None:
        """Start turning."""
        ...

    async def motor_off(self) -> None:
        """Stop turning."""
        ...


class Mission:
    """One exploration, from the first standstill to its result."""

    def __init__(
        self,
        name: str,
        config: Config,
        core: RunCore,
        pilot: Pilot,
        scanner: Callable[[], ScannerPower],
        worker: Executor,
        journal: JournalWriter,
    ) -> None:
        self.name = name
        self.core = core
        self.journal = journal
        self.state = MissionState.CALIBRATING
        self.reason = ""
        self.lrf_on_s = 0.0
        self.dropped_sweeps = 0
        self._config = config
        self._pilot = pilot
        self._scanner = scanner
        self._worker = worker
        self._is_continuous = config.lrf.power == "continuous"
        self._clock = asyncio.get_running_loop().time
        self._go = asyncio.Event()
        self._go.set()
        self._ready = asyncio.Event()
        self._collecting = 0  # revolutions still wanted for the scan being taken
        self._collected = asyncio.Event()
        self._scan_begun_s = 0.0
        self._lrf_on_since_s: float | None = None
        self._is_surveying = False
        self._group: asyncio.TaskGroup | None = None
        self._method: asyncio.Task[None] | None = None
        self._last_tick_s: float | None = None
        self._ticked_at_s = self._clock()

    # ---------------------------------------------------------------- the method

    async def explore(self) -> None:
        """Run to the end; `state` and `reason` tell which. Never raises a RobotError."""
        try:
            await self._run_method()
        except asyncio.CancelledError:
            self._end(MissionState.STOPPED, "ended from outside")
            raise
        finally:
            self._end(MissionState.FAILED, "internal error in the daemon; see its log")
            self._pilot.halt()
            if self._lrf_on_since_s is not None:
                await self._motor_off()

    async def _run_method(self) -> None:
        try:
            async with asyncio.TaskGroup() as self._group:
                if not self.state.is_over:  # stopped before it began
                    self._method = self._group.create_task(self._explore(), name=self.name)
        except* RobotError as group:
            self._end(MissionState.FAILED, str(group.exceptions[0]))

    def stop(self, reason: str, *, failed: bool = False) -> None:
        """End the run where it is; `explore` returns soon after."""
        self._end(MissionState.FAILED if failed else MissionState.STOPPED, reason)
        if self._method is not None:
            self._method.cancel()

    async def _explore(self) -> None:
        await self._calibrate()
        decision = await self._scan_here()
        while isinstance(decision, Drive):
            if self._is_out_of_budget():
                return
            log.info("%s: %s", self.name, decision.reason)
            outcome = await self._drive(decision)
            if outcome is Following.ARRIVED:
                decision = await self._scan_here()
            elif outcome is Following.BLOCKED:
                decision = await self._replan()
            else:
                decision = await self._give_up(decision, outcome)
        ended = MissionState.COMPLETE if decision.is_complete else MissionState.STOPPED
        self._end(ended, decision.reason)

    async def _calibrate(self) -> None:
        """Stand until the gyro's bias is known."""
        if self._is_continuous:
            await self._motor_on()
        try:
            async with asyncio.timeout(CALIBRATION_TIMEOUT_S):
                await self._ready.wait()
        except TimeoutError:
            raise DeviceError(
                f"no steady gyro and wheel readings within {CALIBRATION_TIMEOUT_S:.0f} s of "
                "the start: is the robot being moved, or a device missing? "
                "see `ins-robot status`"
            ) from None

    async def _scan_here(self) -> Decision:
        """Scan at a node: five revolutions standing still, then think."""
        await self._until_standing()
        self.state = MissionState.SCANNING
        await self._collect(self._config.lrf.revolutions)
        rpm = self._scanner().set_rpm
        self._mark("node_scan", set_rpm=rpm)
        job = self.core.prepare_node_scan(rpm)
        self.state = MissionState.THINKING
        outcome = await self._survey(job)
        assert outcome.decision is not None
        return outcome.decision

    async def _drive(self, goal: Drive) -> Following:
        """Follow the path; look around on the way where needed, and stop if it is blocked."""
        self.state = MissionState.DRIVING
        arrival = self._pilot.follow(goal.path)
        while not arrival.done():
            await asyncio.wait({arrival}, timeout=WATCH_PERIOD_S)
            if self._clock() - self._ticked_at_s > MOTORS_GONE_S:
                raise DeviceError(
                    f"motors: no telemetry for {MOTORS_GONE_S:g} s in a drive: cable, supply, "
                    "or the microcontroller's firmware? the wheels stand (its dead-man)"
                )
            if not arrival.done() and self._wants_sweep():
                await self._sweep()
                if not arrival.done() and self._pilot.is_blocked(self.core.pose):
                    self._pilot.halt()
                    return Following.BLOCKED
        return arrival.result()

    async def _give_up(self, goal: Drive, outcome: Following) -> Decision:
        await self._until_standing()
        await self._sweep()  # what stopped the robot may be seen from here
        self.state = MissionState.THINKING
        pose = self.core.pose
        self._mark("give_up", why=str(outcome), pose=[pose.x_m, pose.y_m, pose.heading_rad])
        return await self._in_worker(self.core.give_up, goal, str(outcome), pose)

    async def _replan(self) -> Decision:
        await self._until_standing()
        self.state = MissionState.THINKING
        pose = self.core.pose
        self._mark("replan", pose=[pose.x_m, pose.y_m, pose.heading_rad])
        return await self._in_worker(self.core.replan, pose)

    # ---------------------------------------------------------------- scans

    def _wants_sweep(self) -> bool:
        """The pose is uncertain, or nothing near here has been looked at from near."""
        if self._is_continuous:
            return False
        if self.core.position_std_m > self._config.slam.sweep_std_m:
            return True
        clearance_m = self._pilot.clearance_m(self.core.pose)
        if self.core.last_look_m() * DRIFT > max(clearance_m, TIGHT_M):
            return True
        share = min(1.0, max(CRAMPED_SHARE, clearance_m / ROOMY_M))
        every_m = self._config.lrf.look_every_m * share
        return every_m > 0.0 and self.core.nearest_look_m() > every_m

    async def _sweep(self) -> None:
        """One revolution while driving, to correct the pose along the trajectory."""
        await self._collect(1)
        self._mark("sweep")
        await self._survey(self.core.prepare_sweep())

    async def _collect(self, revolutions: int) -> None:
        """So many steady revolutions; a line lost for a moment gets a second chance."""
        try:
            await self._collect_once(revolutions)
        except DeviceError as error:
            log.warning("%s: %s; once more", self.name, error)
            await asyncio.sleep(RECONNECT_S)
            await self._collect_once(revolutions)

    async def _collect_once(self, revolutions: int) -> None:
        """Let the LRF turn until so many steady revolutions have come in."""
        lrf = self._config.lrf
        timeout_s = 2.0 * lrf.spin_up_timeout_s + 4.0 * revolutions * 60.0 / lrf.rpm
        try:
            if not self._is_continuous:
                await self._motor_on()
            self._mark("scan_begin")
            self.core.begin_scan()
            self._scan_begun_s = self._clock()
            self._collected.clear()
            self._collecting = revolutions
            async with asyncio.timeout(timeout_s):
                await self._collected.wait()
        except TimeoutError:
            raise DeviceError(
                f"lrf: no {revolutions} steady revolutions at {self._scanner().set_rpm:.0f} "
                f"rpm within {timeout_s:.0f} s: motor blocked, belt off, or supply too weak"
            ) from None
        finally:
            self._collecting = 0
            if not self._is_continuous:
                await self._motor_off()

    async def _motor_on(self) -> None:
        self._lrf_on_since_s = self._clock()
        await self._scanner().motor_on()

    async def _motor_off(self) -> None:
        if self._lrf_on_since_s is not None:
            self.lrf_on_s += self._clock() - self._lrf_on_since_s
            self._lrf_on_since_s = None
        with contextlib.suppress(DeviceError):  # a lost LRF turns nothing
            await self._scanner().motor_off()

    def _survey(self, job: ScanJob) -> Coroutine[Any, Any, ScanOutcome]:
        """Hand a scan to the worker at once, in the journal's order; await its outcome."""
        self._is_surveying = True
        return self._steer_by(self._in_worker(self.core.compute, job))

    async def _steer_by(self, computing: Awaitable[ScanOutcome]) -> ScanOutcome:
        try:
            outcome = await computing
            self.core.apply(outcome)
            self._pilot.observe(await self._in_worker(self.core.survey.grid.walls))
        finally:
            self._is_surveying = False
        return outcome

    # ---------------------------------------------------------------- what comes in

    def on_imu(self, sample: ImuSample) -> None:
        """A reading of gyro and compass."""
        self.journal.write(sample)
        self.core.on_imu(sample)

    def on_wheels(self, sample: WheelSample) -> tuple[float, float, float]:
        """A telemetry frame; the wheel speeds that answer it."""
        self.journal.write(sample)
        self.core.on_wheels(sample)
        if not self._ready.is_set() and self.core.odometry.is_ready:
            self._ready.set()
        last_s, self._last_tick_s = self._last_tick_s, sample.stamp_s
        self._ticked_at_s = self._clock()
        dt_s = 0.0 if last_s is None else min(0.1, max(0.0, sample.stamp_s - last_s))
        return self._pilot.tick(self.core.pose, dt_s)

    def on_revolution(self, revolution: LaserScan) -> None:
        """A whole turn of the LRF."""
        rpm = self._scanner().set_rpm
        if abs(revolution.rpm / rpm - 1.0) > self._config.lrf.rpm_tolerance:
            return
        if self._collecting and revolution.stamp_s >= self._scan_begun_s:
            self.journal.write(revolution)
            self.core.on_revolution(revolution)
            self._collecting -= 1
            if not self._collecting:
                self._collected.set()
        elif self._is_continuous and self.state is MissionState.DRIVING:
            self._feed(revolution)

    def _feed(self, revolution: LaserScan) -> None:
        """Continuous LRF: the newest revolution to SLAM, unless it is still at the last."""
        if self._is_surveying:
            self.dropped_sweeps += 1
            return
        self._mark("scan_begin")
        self.core.begin_scan()
        self.journal.write(revolution)
        self.core.on_revolution(revolution)
        self._mark("sweep")
        job = self.core.prepare_sweep()
        assert self._group is not None
        self._group.create_task(self._survey(job), name=f"{self.name} sweep")

    # ---------------------------------------------------------------- the operator

    def pause(self) -> None:
        """Stand, and stay where the method is."""
        self._go.clear()
        self._pilot.is_held = True

    def resume(self) -> None:
        """Go on after `pause`."""
        self._pilot.is_held = False
        self._go.set()

    @property
    def is_paused(self) -> bool:
        """True between `pause` and `resume`."""
        return not self._go.is_set()

    # ---------------------------------------------------------------- small things

    async def _until_standing(self) -> None:
        await self._go.wait()
        await self._pilot.standing.wait()
        await asyncio.sleep(SETTLE_S)

    def _is_out_of_budget(self) -> bool:
        exploration = self._config.exploration
        if self.core.duration_s > exploration.max_time_s:
            self._end(
                MissionState.STOPPED,
                f"exploration.max_time_s = {exploration.max_time_s:g} s is used up",
            )
        return self.state.is_over

    def _end(self, state: MissionState, reason: str) -> None:
        """Set the final state; the first one stays."""
        if self.state.is_over:
            return
        self.state, self.reason = state, reason
        log.info("%s: %s: %s", self.name, state, reason)

    def close_journal(self) -> None:
        """The last words, and all of it on the disk."""
        self._mark("end", state=str(self.state), reason=self.reason, lrf_on_s=self.lrf_on_s)
        self.journal.close()

    def _mark(self, kind: str, **payload: Any) -> None:
        self.journal.write(Mark(stamp_s=self._clock(), kind=kind, payload=payload))

    def _in_worker(self, work: Callable[..., T], *args: Any) -> Awaitable[T]:
        # Shielded: what the journal holds is computed, even when nobody waits for it any more.
        job = asyncio.get_running_loop().run_in_executor(self._worker, work, *args)
        return asyncio.shield(job)
