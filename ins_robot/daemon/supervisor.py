# SPDX-License-Identifier: MIT
"""Runs the daemon's tasks by name: restarts devices, ends everything else together.

An essential task that fails ends the daemon with its error. A device task that fails is logged
and run again after a delay that doubles each time, for as long as the daemon lives. Only here
may any Exception be caught, and where an executor passes it on: `simulation/virtual_clock.py`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeVar

from ins_robot.errors import RobotError, StateError

log = logging.getLogger(__name__)

T = TypeVar("T")
TaskFunction = Callable[[], Coroutine[Any, Any, None]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Backoff:
    """Delays between attempts: first, first*factor, ... up to the limit."""

    first_s: float = 0.25
    factor: float = 2.0
    limit_s: float = 5.0
    healthy_s: float = 10.0  # a task that ran this long starts again with the first delay

    def delay_s(self, failures: int) -> float:
        """The wait after the given number of failures in a row, counted from 1."""
        # Capped exponent: a device that is missing for a day must not overflow a float.
        return min(self.limit_s, self.first_s * self.factor ** min(failures - 1, 64))


class TaskState(StrEnum):
    """What a supervised task is doing."""

    RUNNING = "running"
    WAITING = "waiting"  # failed, will be run again
    FINISHED = "finished"


@dataclass(slots=True)
class TaskReport:
    """What the status shows of a task."""

    state: TaskState = TaskState.RUNNING
    restarts: int = 0
    last_error: str = ""

    def as_dict(self) -> dict[str, Any]:
        """JSON values by name."""
        return {
            "state": str(self.state),
            "restarts": self.restarts,
            "last_error": self.last_error,
        }


@dataclass(slots=True)
class StopLatch:
    """A stop that stays until an operator releases it; the first reason is the one kept."""

    reason: str = ""

    @property
    def is_set(self) -> bool:
        """True while latched."""
        return bool(self.reason)

    def set(self, reason: str) -> bool:
        """Latch; True when it was not latched before."""
        if self.reason:
            return False
        self.reason = reason or "no reason given"
        log.warning("stop latched: %s", self.reason)
        return True

    def clear(self) -> str:
        """Release; returns what the reason was. Raises StateError when not latched."""
        if not self.reason:
            raise StateError("clear: no stop is latched")
        reason, self.reason = self.reason, ""
        log.info("stop released: %s", reason)
        return reason


@dataclass(slots=True)
class Supervisor:
    """A task group of named tasks.

    `add_task` and `add_device` before or while `run` runs; `run` returns after `shut_down`, or
    when all tasks have finished, and raises what an essential task raised.
    """

    backoff: Backoff = field(default_factory=Backoff)
    reports: dict[str, TaskReport] = field(default_factory=dict)
    shutdown_reason: str = ""
    _functions: list[tuple[str, TaskFunction]] = field(default_factory=list)
    _group: asyncio.TaskGroup | None = None
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def add_task(self, name: str, function: TaskFunction) -> None:
        """A task the daemon cannot do without: its error ends everything."""
        self._add(name, lambda: self._run_essential(name, function))

    def add_device(
        self, name: str, function: TaskFunction, on_failure: Callable[[], None] | None = None
    ) -> None:
        """A task that is run again when it fails; `on_failure` is called at each failure."""
        self._add(name, lambda: self._run_device(name, function, on_failure))

    async def run(self) -> None:
        """Run until shut down. The error of an essential task comes out as itself."""
        try:
            async with asyncio.TaskGroup() as self._group:
                for name, function in self._functions:
                    self._start(name, function)
        except ExceptionGroup as group:
            # The group is how TaskGroup reports; the first error is what went wrong, and the
            # others came of being cancelled. It keeps its own traceback.
            for other in group.exceptions[1:]:
                log.error("another task failed too: %s", other, exc_info=other)
            raise group.exceptions[0] from None
        finally:
            self._group = None

    def shut_down(self, reason: str) -> None:
        """End every task, once; the first reason is kept. Safe from a signal handler."""
        if self.shutdown_reason:
            return
        self.shutdown_reason = reason or "no reason given"
        log.info("shutting down: %s", self.shutdown_reason)
        for task in self._tasks:
            task.cancel()

    def as_dict(self) -> dict[str, Any]:
        """Reports by task name, as JSON values."""
        return {name: report.as_dict() for name, report in self.reports.items()}

    def _add(self, name: str, function: TaskFunction) -> None:
        before = self.reports.get(name)
        if before is not None and before.state is not TaskState.FINISHED:
            raise StateError(f"supervisor: a task named '{name}' is already there")
        self.reports[name] = TaskReport()
        if self._group is None:
            self._functions.append((name, function))
        else:
            self._start(name, function)

    def _start(self, name: str, function: TaskFunction) -> None:
        assert self._group is not None
        if self.shutdown_reason:
            return
        task = self._group.create_task(function(), name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run_essential(self, name: str, function: TaskFunction) -> None:
        try:
            await function()
        except Exception as error:  # whatever it was: the status tells it, `run` raises it
            self.reports[name].last_error = _one_line(error)
            raise
        finally:
            self.reports[name].state = TaskState.FINISHED

    async def _run_device(
        self, name: str, function: TaskFunction, on_failure: Callable[[], None] | None
    ) -> None:
        report = self.reports[name]
        loop = asyncio.get_running_loop()
        failures = 0
        while True:
            report.state = TaskState.RUNNING
            began_s = loop.time()
            try:
                await function()
            except Exception as error:  # a bug in one device must not take the others along
                was_healthy = loop.time() - began_s >= self.backoff.healthy_s
                failures = 1 if was_healthy else failures + 1
                delay_s = self.backoff.delay_s(failures)
                _log_failure(name, error, failures, delay_s)
                report.last_error = _one_line(error)
                if on_failure is not None:
                    on_failure()
            else:
                report.state = TaskState.FINISHED
                return
            report.state = TaskState.WAITING
            await asyncio.sleep(delay_s)
            report.restarts += 1


async def outcome_of(work: Awaitable[T], what: str) -> T | RobotError:
    """The result of `work`, or its error as a value; a bug is logged and told as such."""
    try:
        return await work
    except RobotError as error:
        return error
    except Exception as error:  # who asked gets an answer, the daemon lives on
        log.exception("%s: internal error", what)
        return RobotError(
            f"{what}: internal error in the daemon: {_one_line(error)}; see its log"
        )


def _log_failure(name: str, error: Exception, failures: int, delay_s: float) -> None:
    """Tell of the 1st, 2nd, 4th, 8th ... failure in a row: a device may be missing for days."""
    if failures & (failures - 1):
        return
    log.warning(
        "%s; task '%s' runs again in %.2f s (failure %d in a row)",
        _one_line(error),
        name,
        delay_s,
        failures,
        # Of a bug the traceback is worth having; what is raised on purpose says it all.
        exc_info=None if isinstance(error, RobotError) else error,
    )


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, RobotError) and text else f"{type(error).__name__}: {text}"
