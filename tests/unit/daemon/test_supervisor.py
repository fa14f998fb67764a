# SPDX-License-Identifier: MIT
"""Restarts, shutting down and latching, on virtual time."""

from __future__ import annotations

import asyncio
import logging

import pytest

from ins_robot.daemon.supervisor import Backoff, StopLatch, Supervisor, TaskState, outcome_of
from ins_robot.errors import DeviceError, RobotError, StateError
from ins_robot.simulation.virtual_clock import run_virtual

BACKOFF = Backoff(first_s=1.0, factor=2.0, limit_s=5.0, healthy_s=10.0)


async def forever() -> None:
    await asyncio.Event().wait()


def test_a_device_is_run_again_after_doubling_delays_up_to_the_limit() -> None:
    supervisor, starts = Supervisor(backoff=BACKOFF), []

    async def device() -> None:
        starts.append(asyncio.get_running_loop().time())
        if len(starts) == 6:
            supervisor.shut_down("seen enough")
        raise DeviceError("lrf: gone")

    supervisor.add_device("lrf", device)
    run_virtual(supervisor.run())
    assert starts == pytest.approx([0.0, 1.0, 3.0, 7.0, 12.0, 17.0])
    report = supervisor.reports["lrf"]
    assert (report.restarts, report.last_error) == (5, "lrf: gone")


def test_a_device_that_ran_well_for_a_while_starts_again_with_the_first_delay() -> None:
    supervisor, starts = Supervisor(backoff=BACKOFF), []

    async def device() -> None:
        loop = asyncio.get_running_loop()
        starts.append(loop.time())
        if len(starts) == 4:
            supervisor.shut_down("seen enough")
        await asyncio.sleep(20.0 if len(starts) == 3 else 0.0)
        raise DeviceError("lrf: gone")

    supervisor.add_device("lrf", device)
    run_virtual(supervisor.run())
    assert starts == pytest.approx([0.0, 1.0, 3.0, 24.0])


def test_delays_grow_and_never_overflow() -> None:
    delays = [BACKOFF.delay_s(failures) for failures in (1, 2, 3, 4, 5, 10**6)]
    assert delays == [1.0, 2.0, 4.0, 5.0, 5.0, 5.0]


def test_one_failing_device_leaves_the_others_alone_and_is_told_of() -> None:
    supervisor, failures, ticks = Supervisor(backoff=BACKOFF), [], []

    async def broken() -> None:
        raise DeviceError("imu: no answer at 0x68")

    async def healthy() -> None:
        for _ in range(100):
            await asyncio.sleep(0.1)
            ticks.append(1)
        assert supervisor.as_dict()["imu"]["state"] == "waiting"
        supervisor.shut_down("done")

    supervisor.add_device("imu", broken, on_failure=lambda: failures.append(1))
    supervisor.add_task("control", healthy)
    run_virtual(supervisor.run())
    assert len(ticks) == 100
    assert len(failures) == 4  # at 0, 1, 3 and 7 s
    assert supervisor.reports["imu"].restarts == 3


def test_a_bug_in_a_device_task_keeps_its_traceback_and_the_daemon_lives(
    caplog: pytest.LogCaptureFixture,
) -> None:
    supervisor, starts = Supervisor(backoff=BACKOFF), []

    async def device() -> None:
        starts.append(1)
        if len(starts) == 1:
            raise ZeroDivisionError("oh")

    supervisor.add_device("lrf", device)
    with caplog.at_level(logging.WARNING):
        run_virtual(supervisor.run())
    assert len(starts) == 2
    assert "ZeroDivisionError: oh" in caplog.text
    assert "Traceback" in caplog.text
    assert supervisor.reports["lrf"].state is TaskState.FINISHED


def test_a_known_device_error_is_logged_in_one_line(caplog: pytest.LogCaptureFixture) -> None:
    supervisor = Supervisor(backoff=BACKOFF)

    async def device() -> None:
        supervisor.shut_down("once is enough")
        raise DeviceError("lrf: gone")

    supervisor.add_device("lrf", device)
    with caplog.at_level(logging.WARNING):
        run_virtual(supervisor.run())
    assert [record.getMessage() for record in caplog.records] == [
        "lrf: gone; task 'lrf' runs again in 1.00 s (failure 1 in a row)"
    ]
    assert "Traceback" not in caplog.text


def test_a_device_missing_for_a_day_does_not_fill_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    supervisor = Supervisor(backoff=BACKOFF)

    async def device() -> None:
        raise DeviceError("lrf: gone")

    async def day() -> None:
        await asyncio.sleep(86400.0)
        supervisor.shut_down("done")

    supervisor.add_device("lrf", device)
    supervisor.add_task("day", day)
    with caplog.at_level(logging.WARNING):
        run_virtual(supervisor.run())
    assert supervisor.reports["lrf"].restarts > 17_000
    assert len(caplog.records) == 15  # failures 1, 2, 4 ... 16384


def test_the_error_of_an_essential_task_ends_all_and_comes_out_as_itself() -> None:
    supervisor, was_cancelled = Supervisor(), []

    async def essential() -> None:
        await asyncio.sleep(1.0)
        raise StateError("the disk is full")

    async def other() -> None:
        try:
            await forever()
        finally:
            was_cancelled.append(True)

    supervisor.add_task("recorder", essential)
    supervisor.add_device("lrf", other)
    with pytest.raises(StateError, match="the disk is full"):
        run_virtual(supervisor.run())
    assert was_cancelled == [True]
    assert supervisor.reports["recorder"].last_error == "the disk is full"


def test_shutting_down_ends_every_task_with_its_clean_up_and_keeps_the_first_reason() -> None:
    supervisor, cleaned = Supervisor(), []

    def tidy(name: str):
        async def task() -> None:
            try:
                await forever()
            finally:
                await asyncio.sleep(0.5)  # closing takes time, and gets it
                cleaned.append(name)

        return task

    async def trigger() -> None:
        await asyncio.sleep(3.0)
        supervisor.shut_down("SIGTERM")
        supervisor.shut_down("SIGINT")

    supervisor.add_task("a", tidy("a"))
    supervisor.add_device("b", tidy("b"))
    supervisor.add_task("trigger", trigger)
    run_virtual(supervisor.run())
    assert sorted(cleaned) == ["a", "b"]
    assert supervisor.shutdown_reason == "SIGTERM"


def test_a_task_may_be_added_while_running_and_its_name_used_again_when_it_has_finished() -> (
    None
):
    supervisor, ran = Supervisor(), []

    async def late() -> None:
        ran.append(asyncio.current_task().get_name())
        await asyncio.sleep(1.0)

    async def first() -> None:
        supervisor.add_task("run", late)
        with pytest.raises(StateError, match="'run' is already there"):
            supervisor.add_task("run", late)
        await asyncio.sleep(2.0)
        supervisor.add_task("run", late)

    supervisor.add_task("first", first)
    run_virtual(supervisor.run())
    assert ran == ["run", "run"]
    assert set(supervisor.reports) == {"first", "run"}


def test_cancelling_the_supervisor_cancels_its_tasks() -> None:
    supervisor, was_cancelled = Supervisor(), []

    async def task() -> None:
        try:
            await forever()
        finally:
            was_cancelled.append(True)

    async def main() -> None:
        supervisor.add_task("task", task)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0):
                await supervisor.run()

    run_virtual(main())
    assert was_cancelled == [True]


def test_a_stop_stays_latched_until_an_operator_clears_it() -> None:
    latch = StopLatch()
    assert not latch.is_set
    assert latch.set("bumper") is True
    assert latch.set("cliff") is False
    assert (latch.is_set, latch.reason) == (True, "bumper")
    assert latch.clear() == "bumper"
    assert not latch.is_set
    with pytest.raises(StateError, match="no stop is latched"):
        latch.clear()
    latch.set("")
    assert latch.is_set  # also without a reason


def test_outcomes_are_values() -> None:
    async def good() -> int:
        return 7

    async def refused() -> int:
        raise StateError("no")

    async def broken() -> int:
        raise KeyError("x")

    async def main() -> None:
        assert await outcome_of(good(), "good") == 7
        assert isinstance(await outcome_of(refused(), "refused"), StateError)
        bug = await outcome_of(broken(), "broken")
        assert isinstance(bug, RobotError)
        assert "KeyError" in str(bug)

    run_virtual(main())
