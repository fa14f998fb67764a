# SPDX-License-Identifier: MIT
"""A `RobotCommands` that notes what it was asked, and a daemon's thread that serves it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ins_robot.daemon.control_socket import ControlSocket
from ins_robot.errors import InputError, StateError

MAP = {
    "png": b"\x89PNG\r\n\x1a\n\x00\xff" + bytes(range(256)),
    "pgm": b"P5 ",
    "yaml": b"image: map.pgm\n",
}


NEXT = {
    "run": "0001-lab",
    "state": "waiting",
    "reason": "min-gap",
    "goal": {"x_m": 1.0, "y_m": -2.0, "heading_rad": 3.0},
    "bearing_rad": 0.5,
    "distance_m": 2.0,
    "way_m": 2.1,
    "turn_rad": -1.0,
}


class FakeRobot:
    """Answers at once, except where `gate` is set: there `stop` waits."""

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.maps = dict(MAP)
        self.gate: asyncio.Event | None = None
        self.stopping: asyncio.Event | None = None
        self.bug: Exception | None = None
        self.extra_status: dict[str, Any] = {}
        self.is_bare = False

    async def start(self, name: str) -> str:
        self.calls.append(("start", name))
        if name == "again":
            raise StateError("a run is going on: `ins-robot stop` ends it")
        return f"0001-{name.replace('/', '-') or 'run'}"

    async def stop(self) -> str:
        self.calls.append("stop")
        if self.gate is not None and self.stopping is not None:
            self.stopping.set()
            await self.gate.wait()
        return "0001-run"

    async def pause(self) -> None:
        self.calls.append("pause")

    async def resume(self) -> None:
        self.calls.append("resume")

    async def estop(self) -> None:
        self.calls.append("estop")

    async def clear(self) -> None:
        self.calls.append("clear")

    async def status(self) -> dict[str, Any]:
        self.calls.append("status")
        if self.bug is not None:
            raise self.bug
        pose = {"x_m": 1.25, "heading_rad": float("nan")}
        return {"state": "exploring", "pose": pose, **self.extra_status}

    async def map(self, format: str) -> bytes:
        self.calls.append(("map", format))
        return self.maps[format]

    async def next(self) -> dict[str, Any]:
        self.calls.append("next")
        return dict(NEXT)

    async def next_picture(self) -> bytes:
        return MAP["png"]

    async def here(self) -> dict[str, Any]:
        self.calls.append("here")
        return dict(NEXT)

    async def skip(self) -> dict[str, Any]:
        self.calls.append("skip")
        return {"run": "0001-lab", "state": "complete", "reason": "all seen", "goal": None}

    async def scan(self) -> bytes:
        return MAP["png"]

    async def goto(self, x_m: float, y_m: float) -> None:
        self.calls.append(("goto", x_m, y_m))
        if x_m > 100.0:
            raise StateError(f"goto {x_m:g} {y_m:g}: cannot be reached: nobody has been there")

    async def zones(self) -> list[dict[str, Any]]:
        if self.is_bare:
            return []
        return [{"name": "stairs", "kind": "no-go", "points": [[1, 2], [3, 2], [3, -4.5]]}]

    async def add_zone(self, zone: dict[str, Any]) -> None:
        self.calls.append(("add_zone", zone))

    async def remove_zone(self, name: str) -> None:
        self.calls.append(("remove_zone", name))

    async def runs(self) -> list[dict[str, Any]]:
        return [
            {"name": "0001-lab", "state": "complete", "duration_s": 61.4, "scans": 7},
            {"name": "0002-run", "state": "interrupted", "duration_s": None},
            *([{"name": "0001-run", "state": "stopped", "scans": 0}] if self.is_bare else []),
        ]

    async def delete_runs(self, names: list[str]) -> None:
        self.calls.append(("delete_runs", names))
        if "0009-none" in names:
            raise InputError("no run '0009-none'")


@contextlib.contextmanager
def served(path: Path, robot: FakeRobot) -> Iterator[None]:
    """The control socket at `path`, answered by `robot` from a thread of its own."""
    is_open, loops = threading.Event(), []

    async def serve() -> None:
        control = ControlSocket(path, robot)
        await control.open()
        end = asyncio.Event()
        loops.append((asyncio.get_running_loop(), end))
        is_open.set()
        await end.wait()
        await control.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    try:
        assert is_open.wait(10.0)
        yield
    finally:
        for loop, end in loops:
            loop.call_soon_threadsafe(end.set)
        thread.join(10.0)
