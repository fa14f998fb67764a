# SPDX-License-Identifier: MIT
"""The composition root: the only place in the daemon that builds the stack and Generator.

`Robot` owns the devices, the pilot, the worker thread and at most one run at a time. The daemon
command puts a control socket in front of it; `simulate` calls it directly, on virtual time.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ins_robot import __version__
from ins_robot.config import Config, to_toml
from ins_robot.core.carried_core import CarriedCore, make_core
from ins_robot.core.run_result import RunResult, RunState
from ins_robot.daemon.after_run import AfterRun
from ins_robot.daemon.drawing import draw_elsewhere
from ins_robot.daemon.health import Health
from ins_robot.daemon.manual_mission import ManualMission
from ins_robot.daemon.mission import Mission
from ins_robot.daemon.orders import Place
from ins_robot.daemon.pilot import Pilot
from ins_robot.daemon.pipeline import Pipeline
from ins_robot.daemon.run_under_way import MissionState, RunUnderWay
from ins_robot.daemon.single_scan import SingleScan
from ins_robot.daemon.supervisor import StopLatch, Supervisor, outcome_of
from ins_robot.daemon.systemd_notify import SystemdNotifier
from ins_robot.errors import RobotError, StateError
from ins_robot.logs.journal import JOURNAL_NAME, Journal, JournalHeader, JournalWriter
from ins_robot.logs.memory import peak_rss_mb
from ins_robot.logs.run_directory import write_run
from ins_robot.mapping.map_picture import MapPicture
from ins_robot.mapping.zones import Zone
from ins_robot.sensing.ports import Connector

log = logging.getLogger(__name__)

FLUSH_PERIOD_S = 1.0
HOST_WAS_LATE = "dead_man"  # the one fault that is ours to clear

T = TypeVar("T")
Annotate = Callable[[RunResult], RunResult]


class Robot:
    """The running system.

    Parameters
    ----------
    connector : Connector
        Opens the config's ports: the system's, or the simulator's.
    clock_kind : "monotonic" or "virtual"
        Written into the recordings.
    draw : callable
        Turns the picture of a finished run into PNG bytes; by default in a process of its own.
    annotate : callable
        May add to a finished run's result before it is saved (the simulator knows the truth).
    """

    def __init__(
        self,
        config: Config,
        connector: Connector,
        *,
        clock_kind: str = "monotonic",
        notifier: SystemdNotifier | None = None,
        annotate: Annotate = lambda result: result,
        draw: Callable[[MapPicture], bytes] = draw_elsewhere,
    ) -> None:
        self.config = config
        self._clock = asyncio.get_running_loop().time
        self._clock_kind = clock_kind
        self._annotate = annotate
        self._draw = draw
        self._notifier = notifier or SystemdNotifier(None)
        self.health = Health(self._clock())
        self.supervisor = Supervisor()
        self.pipeline = Pipeline(config, connector, self._clock, self.health)
        self.pipeline.on_tick = self._after_tick
        self.pipeline.on_fault = self._on_fault
        self.pilot = Pilot(config)
        self.stop_latch = StopLatch()
        self.single_scan = SingleScan(config.lrf, self.pipeline)
        self.mission: RunUnderWay | None = None
        self.last_goto: str | None = None
        self._after: AfterRun | None = None
        self.finished: asyncio.Event = asyncio.Event()
        self.last_summary: dict[str, Any] | None = None
        self.save_error: RobotError | None = None  # why the last run has no files
        self._survey_worker = ThreadPoolExecutor(1, "survey")
        self._journal_worker = ThreadPoolExecutor(1, "journal")
        self._began_run_s = 0.0
        self._stops = 0
        self.supervisor.add_device("lrf", self.pipeline.serve_lrf)
        self.is_manual = config.base.kind == "manual"
        if not self.is_manual:
            self.supervisor.add_device("imu", self.pipeline.serve_imu)
            self.supervisor.add_device("motors", self.pipeline.serve_motors)
        self.supervisor.add_task("housekeeping", self._keep_house)

    async def serve(self) -> None:
        """Run until `supervisor.shut_down`; ends a run that is under way and saves it."""
        try:
            await self.supervisor.run()
        finally:
            self._survey_worker.shutdown()
            self._journal_worker.shutdown()

    # ---------------------------------------------------------------- runs

    def begin(self, directory: Path, name: str, zones: tuple[Zone, ...] = ()) -> None:
        """Start a run that leaves its files in `directory`, which exists."""
        if self.mission is not None:
            raise StateError(f"run '{self.mission.name}' is under way: stop it first")
        self._check_free()
        header = JournalHeader(
            package_version=__version__,
            run_name=name,
            clock=self._clock_kind,
            config_toml=to_toml(self.config),
        )
        self.pilot = Pilot(self.config)  # at rest, not held, knowing no other run's walls
        self.mission = self._mission(name, JournalWriter(directory / JOURNAL_NAME, header))
        if zones:
            self.mission.forbid_from_start(zones)
        self._after = None
        self.finished.clear()
        self.save_error = None
        self._began_run_s = time.perf_counter()
        self.pipeline.mission = self.mission
        self.supervisor.add_task("run", lambda: self._explore(directory))

    def _check_free(self) -> None:
        """Refuse to set out while stopped, or while the LRF is borrowed."""
        if self.stop_latch.is_set:
            raise StateError(f"stopped: {self.stop_latch.reason}; `ins-robot clear` first")
        self.single_scan.check_idle()

    def _check_whole(self) -> None:
        """Refuse to drive by `goto` besides where a device is missing."""
        self._check_free()
        if self.pipeline.missing:
            missing = ", ".join(self.pipeline.missing)
            raise StateError(f"goto: not there: {missing}; `ins-robot status` tells more")

    def _mission(self, name: str, journal: Journal) -> RunUnderWay:
        rng = np.random.default_rng(self.config.slam.seed)
        core = make_core(self.config, rng, time.thread_time)
        scanner, worker = (lambda: self.pipeline.scanner), self._survey_worker
        if isinstance(core, CarriedCore):
            return ManualMission(name, self.config, core, scanner, worker, journal)
        return Mission(name, self.config, core, self.pilot, scanner, worker, journal)

    async def end(self, reason: str, *, failed: bool = False) -> str:
        """Stop the run and wait until its files are there; its name.

        Raises
        ------
        StateError
            When there is no run.
        RobotError
            When it ended, but could not be saved.
        """
        if self.mission is None:
            raise StateError("no run is under way")
        name = self.mission.name
        self.mission.stop(reason, failed=failed)
        await self.finished.wait()
        if self.save_error is not None:
            raise self.save_error
        return name

    async def _explore(self, directory: Path) -> None:
        mission = self.mission
        assert mission is not None
        try:
            await mission.explore()
            await self.pilot.rest()  # the last of the way belongs to the run
        finally:
            self._stay_in_the_map(mission)  # before it is saved, which may take long
            try:
                saving = self._in_survey_worker(lambda: self._save(mission, directory))
                # Shielded: a second cancellation must not take it out of the worker's queue.
                saved = await outcome_of(
                    asyncio.shield(saving), f"run '{mission.name}' not saved"
                )
                if isinstance(saved, RobotError):
                    self._tell_unsaved(mission, saved)
                else:
                    self.last_summary = saved
            finally:
                self.mission = None
                self.finished.set()

    def _stay_in_the_map(self, run: RunUnderWay) -> None:
        """Go on knowing where the robot is on the map of a run that has ended.

        Unless its devices failed it: the robot may be anywhere by then.
        """
        self._after, core = None, run.core
        is_lost = self.is_manual or run.was_let_down or bool(self.pipeline.missing)
        if not is_lost and core.survey.explorer.graph.nodes:
            scanner, worker = (lambda: self.pipeline.scanner), self._survey_worker
            self._after = AfterRun("goto", self.config, core, self.pilot, scanner, worker)
        self.pipeline.mission = self._after  # not a frame passes it by

    async def forbid(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls, in the run under way or on the map after one."""
        while self.mission is not None and self.mission.state.is_over:
            await self.finished.wait()  # what is saved is as its recording tells it
        on_map = self.mission or self._after
        if on_map is not None:
            await on_map.forbid(zones)

    async def go_to(self, place_m: Place) -> None:
        """Drive to a place of the map; returns when the robot sets out.

        Raises
        ------
        StateError
            When there is no map, or no known way leads there.
        """
        if self.mission is not None:
            await self.mission.go_to(place_m)
            return
        after = self._after
        if after is None:
            raise StateError("goto: the robot is on no map: `ins-robot start` makes one")
        self._check_whole()
        with self.single_scan.lent_to("goto"):  # it may have to look around for a way
            await after.look_for_way(place_m)
        if self.mission is not None or self._after is not after:
            raise StateError("goto: something else has begun meanwhile")
        self._check_whole()  # of what happened during the look too
        after.place_m, self.mission = place_m, after
        self.finished.clear()
        self.save_error = None
        self.supervisor.add_task("goto", lambda: self._run_errand(after))

    async def _run_errand(self, errand: AfterRun) -> None:
        try:
            await errand.explore()
        finally:
            self.last_goto = errand.reason
            self._stay_in_the_map(errand)
            self.mission = None
            self.finished.set()

    def _save(self, mission: RunUnderWay, directory: Path) -> dict[str, Any]:
        try:
            mission.close_journal()
        except RobotError as error:
            log.error("the end of the recording is lost: %s", error)  # the map need not be
        mission.core.settle()
        return write_run(directory, self._annotate(self._result(mission)), self._draw)

    def _tell_unsaved(self, mission: RunUnderWay, error: RobotError) -> None:
        log.error("run '%s' is not saved: %s", mission.name, error)
        self.save_error = error
        self.last_summary = {
            "name": mission.name,
            "state": str(MissionState.FAILED),
            "reason": f"not saved: {error}",
        }

    async def snapshot(self, use: Callable[[RunResult], T]) -> T:
        """What `use` makes of the run under way, as if it ended now; in the survey worker.

        There, because nowhere else does the grid stand still.
        """
        mission = self.mission
        if mission is None:
            raise StateError("no run is under way")
        return await self._in_survey_worker(lambda: use(self._result(mission)))

    def _result(self, mission: RunUnderWay) -> RunResult:
        is_over = mission.state.is_over
        return mission.core.result(
            name=mission.name,
            state=RunState(mission.state) if is_over else RunState.STOPPED,
            reason=mission.reason if is_over else "under way",
            lrf_on_s=mission.lrf_on_s,
            wall_time_s=time.perf_counter() - self._began_run_s,
            peak_rss_mb=peak_rss_mb(),
            notes={
                "dropped_sweeps": mission.dropped_sweeps,
                "guard_ticks": self.pilot.guard_ticks,
            },
        )

    # ---------------------------------------------------------------- stopping for safety

    def stop_motors(self, reason: str) -> None:
        """Zero at once, latched; a run pauses."""
        self._check_motors()
        self.pilot.stop_now()
        self._stops += 1
        self.stop_latch.set(reason)
        if self.mission is not None:
            self.mission.pause()

    async def release_motors(self) -> None:
        """Clear the latch and re-arm the microcontroller; a run stays paused."""
        self._check_motors()
        stops = self._stops
        await self.pipeline.motors.rearm()
        if self._stops != stops:
            raise StateError("clear: stopped again meanwhile; nothing is released")
        self.stop_latch.clear()
        self.pilot.release()

    def _check_motors(self) -> None:
        if self.is_manual:
            raise StateError(
                'base.kind = "manual": there are no motors to stop; `ins-robot pause` or `stop`'
            )

    def _on_fault(self, fault: str) -> None:
        if fault == HOST_WAS_LATE:
            self.health.count(fault)
            self.supervisor.add_task("re-arm", self._go_on)
        else:
            self.stop_motors(f"motor controller: {fault}")

    async def _go_on(self) -> None:
        """The wheels stopped because this process was late, not because of the world."""
        self.pilot.start_from_rest()
        try:
            await self.pipeline.motors.rearm()
        except RobotError as error:
            self.stop_motors(str(error))

    # ---------------------------------------------------------------- housekeeping

    def _after_tick(self, now_s: float) -> None:
        self._notifier.feed_watchdog(now_s)

    async def _keep_house(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(FLUSH_PERIOD_S)
            now_s = self._clock()
            self.health.roll(now_s)
            mission = self.mission
            if mission is not None and not mission.state.is_over:
                try:
                    await loop.run_in_executor(self._journal_worker, mission.journal.flush)
                except RobotError as error:
                    mission.stop(str(error), failed=True)
                self._check_battery(mission)
                log.info("%s", self.health.line(now_s))
            if self.pipeline.missing and (mission is None or mission.state.is_over):
                self._after = self.pipeline.mission = None  # it may be anywhere by now
            if self.is_manual or "motors" in self.pipeline.missing:
                self._notifier.feed_watchdog(now_s)  # nothing to control is not a hang

    def _check_battery(self, mission: RunUnderWay) -> None:
        limit_v, wheels = self.config.wheels.battery_low_v, self.pipeline.last_wheels
        if wheels is not None and wheels.battery_v < limit_v:
            mission.stop(
                f"battery at {wheels.battery_v:.1f} V, wheels.battery_low_v = {limit_v:g}"
            )

    async def _in_survey_worker(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._survey_worker, work)


def mission_state(robot: Robot) -> str:
    """One word for the status: what the robot is doing."""
    if robot.stop_latch.is_set:
        return "stopped for safety"
    if robot.mission is None:
        return "idle"
    if robot.mission.is_paused and not robot.mission.state.is_over:
        return "paused"
    return str(robot.mission.state)


__all__ = ["MissionState", "Robot", "mission_state"]
