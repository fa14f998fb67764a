# SPDX-License-Identifier: MIT
"""What the control socket's commands do: `RobotCommands` on a `Robot` and its run store."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from ins_robot import __version__
from ins_robot.core.run_result import RunResult
from ins_robot.daemon.after_run import AfterRun
from ins_robot.daemon.directions import directions, picture_with
from ins_robot.daemon.drawing import draw_elsewhere
from ins_robot.daemon.manual_mission import ManualMission
from ins_robot.daemon.run_store import RunStore
from ins_robot.daemon.run_under_way import MissionState, RunUnderWay
from ins_robot.daemon.runtime import Robot, mission_state
from ins_robot.daemon.zone_store import ZoneStore
from ins_robot.errors import StateError
from ins_robot.logs.run_directory import MAP_PGM, MAP_PNG, MAP_YAML, MARGIN_CELLS, picture_of
from ins_robot.mapping.map_files import TernaryMap, pgm_bytes, yaml_text
from ins_robot.mapping.zones import Zone, zone_of, zones_as_json
from ins_robot.sensing.scan_summary import polar_picture

FILES = {"png": MAP_PNG, "pgm": MAP_PGM, "yaml": MAP_YAML}


class DaemonCommands:
    """Carries out the commands of clients."""

    def __init__(self, robot: Robot, store: RunStore) -> None:
        self._robot = robot
        self._store = store
        self._zones = ZoneStore(store.root)
        self._one_change = asyncio.Lock()

    async def start(self, name: str) -> str:
        """Begin a run; its full name."""
        async with self._one_change:  # a zone added meanwhile would not be the run's
            return self._begin(name, await asyncio.to_thread(self._zones.load))

    def _begin(self, name: str, zones: tuple[Zone, ...]) -> str:
        under_way = self._robot.mission
        if under_way is not None:
            what = (
                "a drive by goto"
                if isinstance(under_way, AfterRun)
                else f"run '{under_way.name}'"
            )
            raise StateError(f"{what} is under way: `ins-robot stop` ends it")
        missing = self._robot.pipeline.missing
        if missing:
            reports = self._robot.supervisor.reports
            why = "; ".join(f"{device}: {reports[device].last_error}" for device in missing)
            raise StateError(f"not all devices are there: {why}")
        if self._robot.stop_latch.is_set:
            raise StateError(
                f"stopped: {self._robot.stop_latch.reason}; `ins-robot clear` releases it"
            )
        self._robot.single_scan.check_idle()
        directory = self._store.create(name)
        self._robot.begin(directory, directory.name, zones)
        return directory.name

    async def stop(self) -> str:
        """End the run; its name, once its files are there."""
        return await self._robot.end("stopped by the operator")

    async def pause(self) -> None:
        """Stand still."""
        self._mission().pause()

    async def resume(self) -> None:
        """Go on."""
        if self._robot.stop_latch.is_set:
            raise StateError(
                f"stopped: {self._robot.stop_latch.reason}; `ins-robot clear` releases it first"
            )
        self._mission().resume()

    async def estop(self) -> None:
        """Stop the motors now, latched."""
        self._robot.stop_motors("emergency stop by the operator")

    async def clear(self) -> None:
        """Release what is latched."""
        await self._robot.release_motors()

    async def status(self) -> dict[str, Any]:
        """Everything a person or a program may want to know, as JSON values."""
        robot, now_s = self._robot, asyncio.get_running_loop().time()
        wheels, mission = robot.pipeline.last_wheels, robot.mission
        status: dict[str, Any] = {
            "state": mission_state(robot),
            "version": __version__,
            "run": None if mission is None else mission.name,
            "stop": robot.stop_latch.reason,
            "missing": robot.pipeline.missing,
            "fault": "" if wheels is None else wheels.fault,
            "battery_v": None if wheels is None else wheels.battery_v,
            "tasks": robot.supervisor.as_dict(),
            "health": robot.health.as_dict(now_s),
            "paused_because": "" if mission is None else mission.paused_because,
            "last_run": robot.last_summary,
            "last_goto": robot.last_goto,
        }
        if mission is not None:
            core = mission.core
            pose = core.pose
            status |= {
                "pose": {"x_m": pose.x_m, "y_m": pose.y_m, "heading_rad": pose.heading_rad},
                "position_std_m": core.position_std_m,
                "duration_s": core.duration_s,
                "path_length_m": core.path_length_m,
                "scans": core.scans,
                "sweeps": core.sweeps,
                "lrf_on_s": mission.lrf_on_s,
                "goal": directions(mission)["goal"],
            }
        return status

    async def map(self, format: str) -> bytes:
        """The running map, else the last finished one."""
        if self._robot.mission is None:
            path = self._store.latest_with(FILES[format])
            if path is None:
                raise StateError(self._why_no_map())
            return path.read_bytes()
        if format == "png":
            picture = await self._robot.snapshot(picture_of)
            return await asyncio.to_thread(draw_elsewhere, picture)
        return await self._robot.snapshot(lambda result: _encoded(result, format))

    def _why_no_map(self) -> str:
        names = self._store.names()
        if not names:
            return "no map yet: `ins-robot start` makes one"
        return (
            f"no map yet: run '{names[-1]}' was interrupted; "
            f"`ins-robot replay {self._store.path(names[-1])} --out DIR` makes its map"
        )

    async def next(self) -> dict[str, Any]:
        """Where the run goes next."""
        return directions(self._mission())

    async def next_picture(self) -> bytes:
        """The same, on the map."""
        goal = self._mission().goal
        picture = await self._robot.snapshot(lambda result: picture_with(goal, result))
        return await asyncio.to_thread(draw_elsewhere, picture)

    async def here(self) -> dict[str, Any]:
        """Scan where a person has put the LRF down."""
        self._robot.single_scan.check_idle()
        mission = self._manual_mission()
        await mission.here()
        return directions(mission)

    async def skip(self) -> dict[str, Any]:
        """Name another place."""
        mission = self._manual_mission()
        await mission.skip()
        return directions(mission)

    async def scan(self) -> bytes:
        """One scan, whatever base there is, as long as nothing moves."""
        mission = self._robot.mission
        if mission is not None and mission.state is not MissionState.WAITING:
            raise StateError(
                f"scan: run '{mission.name}' is under way and needs the LRF itself; "
                "`ins-robot stop` ends it"
            )
        revolutions = await self._robot.single_scan.take()
        picture = polar_picture(revolutions, self._robot.config.lrf)
        return await asyncio.to_thread(draw_elsewhere, picture)

    async def goto(self, x_m: float, y_m: float) -> None:
        """Drive to a place, in a run or after one."""
        if self._robot.stop_latch.is_set:
            raise StateError(
                f"goto: stopped: {self._robot.stop_latch.reason}; `ins-robot clear` releases "
                "it, then `ins-robot resume` when a run is paused"
            )
        await self._robot.go_to((float(x_m), float(y_m)))

    async def zones(self) -> list[dict[str, Any]]:
        """All zones."""
        return zones_as_json(await asyncio.to_thread(self._zones.load))

    async def add_zone(self, zone: dict[str, Any]) -> None:
        """One more, for the run under way and all later ones."""
        await self._forbid(lambda: self._zones.add(zone_of(zone)))

    async def remove_zone(self, name: str) -> None:
        """One less."""
        await self._forbid(lambda: self._zones.remove(name))

    async def _forbid(self, change: Callable[[], tuple[Zone, ...]]) -> None:
        async with self._one_change:  # of two at a time the file would keep one
            zones = await asyncio.to_thread(change)  # corners to check, a disk to sync
            await self._robot.forbid(zones)

    async def runs(self) -> list[dict[str, Any]]:
        """All recorded runs."""
        return [info.as_dict() for info in self._store.infos(self._current())]

    async def delete_runs(self, names: list[str]) -> None:
        """Remove recorded runs."""
        self._store.delete(names, self._current())

    def _current(self) -> str | None:
        return None if self._robot.mission is None else self._robot.mission.name

    def _manual_mission(self) -> ManualMission:
        mission = self._mission()
        if not isinstance(mission, ManualMission):
            raise StateError('the robot drives by itself: only base.kind = "manual" is carried')
        return mission

    def _mission(self) -> RunUnderWay:
        if self._robot.mission is None:
            raise StateError("no run is under way: `ins-robot start` begins one")
        return self._robot.mission


def _encoded(result: RunResult, format: str) -> bytes:
    """The map of a run as PGM or YAML."""
    ternary = TernaryMap.of(result.grid).cropped(MARGIN_CELLS)
    return pgm_bytes(ternary) if format == "pgm" else yaml_text(ternary, MAP_PGM).encode()
