# SPDX-License-Identifier: MIT
"""One run of the robot on wheels: stand, scan, decide, drive, until nothing is left to see."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Executor
from functools import partial
from typing import Any

from ins_robot.config import Config
from ins_robot.control.path_follower import Following
from ins_robot.core.budget import Budget
from ins_robot.core.run_core import RunCore, ScanJob, ScanOutcome
from ins_robot.core.survey import Decision
from ins_robot.core.whereabouts import LOOKS_MAX, Found, Unknown
from ins_robot.daemon.orders import Orders, Place, answer
from ins_robot.daemon.pilot import Pilot
from ins_robot.daemon.run_under_way import MissionState, RunUnderWay
from ins_robot.daemon.scan_taking import ScannerPower
from ins_robot.errors import DeviceError, StateError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import Journal
from ins_robot.mapping.zones import Zone
from ins_robot.messages import ImuSample, LaserScan, WheelSample
from ins_robot.navigation.explorer import Drive

log = logging.getLogger(__name__)

CALIBRATION_TIMEOUT_S = 60.0
WATCH_PERIOD_S = 0.2  # how often a drive looks at its pose uncertainty
ROOMY_M = 0.4  # with this much clearance `lrf.look_every_m` is taken as it is
CRAMPED_SHARE = 0.15  # and no less than this share of it among obstacles
DRIFT = 0.04  # of the way since the last look the pose may be off, with slipping wheels,
DRIFT_STDS = 2.7  # or so many times what it was off by on this floor ...
DRIFT_MAX = 0.15  # ... up to this: a robot that is pushed about need not creep
TIGHT_M = 0.008  # what counts as clearance in the tightest place
MOTORS_GONE_S = 10.0  # without telemetry for so long a drive has ended, badly
RUN_ENDED = "goto: the run has ended; ask again"
GYRO_REST_S = 2.2  # to stop, be known to stand, and hear what the gyro reads then
SETTLE_S = 0.2  # from the last command to standing still


class Mission(RunUnderWay):
    """One exploration, from the first standstill to its result."""

    def __init__(
        self,
        name: str,
        config: Config,
        core: RunCore,
        pilot: Pilot,
        scanner: Callable[[], ScannerPower],
        worker: Executor,
        journal: Journal,
    ) -> None:
        super().__init__(name, config, core, scanner, worker, journal)
        self._pilot = pilot
        self._orders = Orders()
        self._budget = Budget(config)
        self._is_going_home = False
        self._ready = asyncio.Event()
        self._is_surveying = False
        self._is_looking = self._stands_to_look = False
        self._pauses_s: list[float] = []  # since it was last known where the robot is
        self._last_tick_s: float | None = None
        self._ticked_at_s = self._clock()

    # ---------------------------------------------------------------- the method

    def _halt(self) -> None:
        """Bring the wheels to a stand."""
        self._pilot.halt()
        self._orders.refuse(RUN_ENDED)

    async def _explore(self) -> None:
        await self._calibrate()
        decision = await self._take_up(await self._scan_here())
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
            decision = await self._take_up(decision)
        ended = MissionState.COMPLETE if decision.is_complete else MissionState.STOPPED
        self._end(ended, decision.reason)

    async def _take_up(self, decision: Decision) -> Decision:
        """What people asked for meanwhile, and what time, way and battery say, come first."""
        if self._pauses_s:
            decision = await self._replan()
        if self._orders.zones_changed:
            self._orders.zones_changed = False
            decision = await self._replan()
            await self._look_out()  # it may have rolled onto what was forbidden just now
        taken = self._orders.take_place()
        if taken is not None:
            decision = await self._send_to(*taken, decision)
        if isinstance(decision, Drive) and (why := self._why_home(decision)) is not None:
            self._is_going_home = True
            pose = self._mark_here("go_home", why=why)
            decision = await self._in_worker(self.core.go_home, why, pose)
        return decision

    async def _send_to(
        self, place_m: Place, told: asyncio.Future[None], otherwise: Decision
    ) -> Decision:
        """To a place, if a way leads there and what is left of the budget does too."""
        pose = self._mark_here("goto", x_m=place_m[0], y_m=place_m[1])
        try:
            drive = await self._in_worker(self.core.go_to, place_m, pose)
        except StateError as error:
            answer(told, error)
            return otherwise
        except asyncio.CancelledError:
            answer(told, StateError(RUN_ENDED))
            raise
        why = self._why_home(drive)
        if why is None:
            answer(told, None)
            return drive
        answer(told, StateError(f"goto: too far: on the way home {why}"))
        pose = self._mark_here("give_up", why=why)
        return await self._in_worker(self.core.give_up, drive, why, pose)

    def _mark_here(self, kind: str, **payload: Any) -> Pose2:
        """A mark with the pose it happened at, which is returned."""
        pose = self.core.pose
        self._mark(kind, **payload, pose=[pose.x_m, pose.y_m, pose.heading_rad])
        return pose

    def _why_home(self, goal: Drive, driven_m: float = 0.0) -> str | None:
        """Why exploring must end now, `driven_m` after the robot set out for the goal."""
        if self._is_going_home:
            return None
        way_m = driven_m + (goal.path.length_m if goal.home_m is None else goal.home_m)
        if not driven_m:  # about to set out: there, and in the worst case back the same way
            way_m += 2.0 * goal.path.length_m
        core = self.core
        return self._budget.why_home(core.duration_s, core.path_length_m, way_m)

    async def _calibrate(self) -> None:
        """Stand until the gyro's bias is known."""
        if self._taker.is_always_on:
            await self._taker.switch_on()
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
        while not await self._until_standing():
            await self._take_whole()
            if not self._pauses_s:  # else it may have been carried while it turned
                outcome = await self._survey(self._node_scan())
                assert outcome.decision is not None
                return outcome.decision
        return await self._replan()

    async def _drive(self, goal: Drive) -> Following:
        """Follow the path, until it is blocked or the run is paused; look around on the way."""
        if self._pauses_s:
            return Following.BLOCKED
        self.state, self.goal = MissionState.DRIVING, goal
        arrival = self._pilot.follow(goal.path)
        begun_m = self.core.path_length_m
        while not arrival.done():
            await asyncio.wait({arrival}, timeout=WATCH_PERIOD_S)
            if self._clock() - self._ticked_at_s > MOTORS_GONE_S:
                raise DeviceError(
                    f"motors: no telemetry for {MOTORS_GONE_S:g} s in a drive: cable, supply, "
                    "or the microcontroller's firmware? the wheels stand (its dead-man)"
                )
            driven_m = max(1e-3, self.core.path_length_m - begun_m)
            is_stopped = self._orders.are_waiting or self._why_home(goal, driven_m)
            if self._pauses_s or (is_stopped and not arrival.done()):
                self._pilot.halt()
                return Following.BLOCKED
            if not arrival.done() and self._wants_sweep():
                await self._sweep_on_the_way()
                if not arrival.done() and self._pilot.is_blocked(self.core.pose):
                    self._pilot.halt()
                    return Following.BLOCKED
        return arrival.result()

    async def _give_up(self, goal: Drive, outcome: Following) -> Decision:
        if await self._until_standing():
            return await self._replan()
        await self._sweep()  # what stopped the robot may be seen from here
        self.state = MissionState.THINKING
        pose = self._mark_here("give_up", why=str(outcome))
        return await self._in_worker(self.core.give_up, goal, str(outcome), pose)

    async def _replan(self) -> Decision:
        await self._until_standing()
        self.state = MissionState.THINKING
        pose = self._mark_here("replan")
        return await self._in_worker(self.core.replan, pose)

    # ---------------------------------------------------------------- scans

    def _wants_sweep(self) -> bool:
        """The pose is uncertain, or nothing near here has been looked at from near."""
        if self._taker.is_always_on:
            return False
        if self.core.position_std_m > self._config.slam.sweep_std_m:
            return True
        if self._may_touch():
            return True
        clearance_m = self._pilot.clearance_m(self.core.pose)
        share = min(1.0, max(CRAMPED_SHARE, clearance_m / ROOMY_M))
        every_m = self._config.lrf.look_every_m * share
        return every_m > 0.0 and self.core.nearest_look_m() > every_m

    def _may_touch(self) -> bool:
        """The pose may have drifted by as much as there is clearance."""
        clearance_m = self._pilot.clearance_m(self.core.pose)
        drift = min(max(DRIFT, DRIFT_STDS * self.core.drift.per_m), DRIFT_MAX)
        return self.core.last_look_m() * drift > max(clearance_m, TIGHT_M)

    async def _sweep_on_the_way(self) -> None:
        """A sweep while driving; standing from where to go on blindly may end at a wall."""
        self._is_looking = True
        self._mind_the_wall()
        try:
            await self._sweep()
            if self.core.survey.slam.was_astray and not self._pauses_s:
                self._stands_to_look = True  # the gyro may have stepped: at rest that shows
                self._hold()
                await asyncio.sleep(GYRO_REST_S)
        finally:
            self._is_looking = self._stands_to_look = False
            self._hold()

    def _mind_the_wall(self) -> None:
        """Until the sweep has told, stop where the robot may touch."""
        if self._is_looking and not self._stands_to_look:
            self._stands_to_look = self._may_touch()
            self._hold()

    def _hold(self) -> None:
        """Stand on the way for as long as there is a reason to."""
        self._pilot.is_held = self.is_paused or self._stands_to_look

    async def _sweep(self) -> None:
        """One revolution while driving, to correct the pose along the trajectory."""
        await self._taker.take(1, self._begin_scan)
        if self._pauses_s:
            return  # it may have been carried meanwhile
        self._mark("sweep")
        await self._survey(self.core.prepare_sweep())

    # ---------------------------------------------------------------- after a pause

    async def _find_itself(self) -> None:
        """Look where the robot is: somebody may have carried it. Unknown: pause again."""
        pauses, advice = len(self._pauses_s), ""
        for nth in range(LOOKS_MAX):
            await self._take_whole()
            if len(self._pauses_s) != pauses:
                return  # carried again, perhaps
            found = await self._look(is_first=nth == 0)
            if not isinstance(found, Unknown):
                del self._pauses_s[:pauses]
                await self._look_out()
                return
            advice = found.advice(self.core.pose)
        self.pause(advice)
        log.warning("%s: paused: %s", self.name, self.paused_because)

    async def _look(self, *, is_first: bool) -> Found:
        rpm, paused_s = self._taker.set_rpm, self._pauses_s[0]
        self._mark("look", set_rpm=rpm, paused_s=paused_s, is_first=is_first)
        look = self.core.prepare_look(rpm)
        self.state = MissionState.THINKING
        find = partial(self.core.find_itself, look, paused_s, is_first=is_first)
        found = await self._in_worker(find)
        log.info("%s: after the pause: %s", self.name, found)
        return found

    def _survey(self, job: ScanJob) -> Coroutine[Any, Any, ScanOutcome]:
        """Hand a scan to the worker at once, in the journal's order; await its outcome."""
        self._is_surveying = True
        return self._steer_by(self._in_worker(self.core.compute, job))

    async def _steer_by(self, computing: Awaitable[ScanOutcome]) -> ScanOutcome:
        try:
            outcome = await computing
            await self._look_out()
        finally:
            self._is_surveying = False
        return outcome

    async def _look_out(self) -> None:
        """Tell the guard what is in the way of a robot that is where this one is."""
        self._pilot.observe(await self._in_worker(self.core.survey.obstacles, self.core.pose))

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
        self._budget.weigh_battery(sample.battery_v)
        self._mind_the_wall()
        dt_s = 0.0 if last_s is None else min(0.1, max(0.0, sample.stamp_s - last_s))
        return self._pilot.tick(self.core.pose, dt_s)

    def on_revolution(self, revolution: LaserScan) -> None:
        """A whole turn of the LRF."""
        if not self._taker.is_steady(revolution):
            return
        if self._taker.wants(revolution):
            self._record(revolution)
        elif self._taker.is_always_on and self.state is MissionState.DRIVING:
            self._feed(revolution)

    def _feed(self, revolution: LaserScan) -> None:
        """Continuous LRF: the newest revolution to SLAM, unless it is still at the last."""
        if self._pauses_s:
            return  # nobody knows from where it is
        if self._is_surveying:
            self.dropped_sweeps += 1
            return
        self._begin_scan()
        self._record(revolution)
        self._mark("sweep")
        job = self.core.prepare_sweep()
        assert self._group is not None
        self._group.create_task(self._survey(job), name=f"{self.name} sweep")

    # ---------------------------------------------------------------- the operator

    async def forbid(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls from now on; the way is looked at again."""
        await super().forbid(zones)
        await self._look_out()
        self._orders.zones_changed = True

    async def go_to(self, place_m: Place) -> None:
        """Drive to a place (x, y) of the map, scan there, and go on exploring."""
        if self.state.is_over:
            raise StateError("goto: the run has ended and is being saved; ask again")
        if self._is_going_home:
            raise StateError("goto: time, way or battery are used up; ask again at home")
        if self.is_paused:
            raise StateError("goto: the run is paused: `ins-robot resume` first")
        await self._orders.go_to(place_m)

    def pause(self, because: str = "") -> None:
        """Stand, and stay where the method is."""
        super().pause(because)
        self._pauses_s.append(self._clock())
        self._hold()

    def resume(self) -> None:
        """Go on after `pause`."""
        super().resume()
        self._hold()

    # ---------------------------------------------------------------- small things

    async def _until_standing(self) -> bool:
        """Stand where the robot knows that it is; whether it had to find that out anew."""
        await self._stand()
        if not self.core.scans:
            self._pauses_s.clear()  # no map to be carried on
        was_paused = bool(self._pauses_s)
        while self._pauses_s:
            await self._stand()
            await self._find_itself()
        return was_paused

    async def _stand(self) -> None:
        await self._go.wait()
        await self._pilot.standing.wait()
        await asyncio.sleep(SETTLE_S)
