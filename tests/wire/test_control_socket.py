# SPDX-License-Identifier: MIT
"""The control socket against clients that behave, and clients that do not."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import stat
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from fake_robot import FakeRobot

from ins_robot.daemon import control_protocol as protocol
from ins_robot.daemon.control_socket import CLIENTS_MAX, ControlSocket
from ins_robot.errors import DeviceError, StateError

STATUS = b'{"v":1,"command":"status"}\n'
STOP = b'{"v":1,"command":"stop"}\n'


def with_socket(
    path: Path, robot: FakeRobot, scenario: Callable[[], Awaitable[None]], **options: float
) -> None:
    async def run() -> None:
        control = ControlSocket(path, robot, **options)
        await control.open()
        try:
            async with asyncio.timeout(10.0):
                await scenario()
        finally:
            await control.close()

    asyncio.run(run())


async def ask(path: Path, *lines: bytes) -> list[dict[str, Any]]:
    """Send the lines on one connection; the replies, fewer when the daemon hangs up."""
    reader, writer = await asyncio.open_unix_connection(path, limit=1 << 26)
    writer.write(b"".join(lines))
    replies = []
    while len(replies) < len(lines) and (line := await reader.readline()):
        replies.append(json.loads(line))
    writer.close()
    return replies


def test_requests_of_one_connection_are_answered_in_order(tmp_path: Path) -> None:
    path, robot = tmp_path / "s", FakeRobot()

    async def scenario() -> None:
        replies = await ask(
            path,
            b'{"v":1,"command":"start","arguments":{"name":"lab"}}\n',
            b'{"v":1,"command":"pause"}\n',
            STATUS,
        )
        assert [reply["ok"] for reply in replies] == [True, True, True]
        assert replies[0]["result"] == "0001-lab"
        assert replies[2]["result"]["pose"] == {
            "x_m": 1.25,
            "heading_rad": None,
        }  # NaN: no JSON

    with_socket(path, robot, scenario)
    assert robot.calls == [("start", "lab"), "pause", "status"]


@pytest.mark.parametrize(
    "line",
    [
        b"\n",
        b"status\n",
        b"\xff\xfe\x00\n",
        b"[1, 2]\n",
        b"[" * 20000 + b"\n",
        b'{"v":1}\n',
        b'{"v":2,"command":"status"}\n',
        b'{"command":"status"}\n',
        b'{"v":1,"command":"__class__"}\n',
        b'{"v":1,"command":["status"]}\n',
        b'{"v":1,"command":"status","arguments":[]}\n',
        b'{"v":1,"command":"status","arguments":{"now":1}}\n',
        b'{"v":1,"command":"start"}\n',
        b'{"v":1,"command":"start","arguments":{"name":7}}\n',
        b'{"v":1,"command":"delete_runs","arguments":{"names":"0001-a"}}\n',
        b'{"v":1,"command":"delete_runs","arguments":{"names":[1]}}\n',
        b'{"v":1,"command":"map","arguments":{"format":"../etc"}}\n',
    ],
)
def test_nonsense_gets_an_error_and_the_connection_lives_on(
    tmp_path: Path, line: bytes
) -> None:
    path, robot = tmp_path / "s", FakeRobot()

    async def scenario() -> None:
        refused, status = await ask(path, line, STATUS)
        assert refused["ok"] is False
        assert refused["error"]["kind"] == "WireError"
        assert "\n" not in refused["error"]["message"]
        assert status["ok"] is True

    with_socket(path, robot, scenario)
    assert robot.calls == ["status"]


def test_a_request_without_end_is_refused_and_not_carried_out(tmp_path: Path) -> None:
    path, robot = tmp_path / "s", FakeRobot()

    async def scenario() -> None:
        endless = await ask(path, b"x" * (protocol.REQUEST_MAX_BYTES + 10))
        assert "longer than 65536 bytes" in endless[0]["error"]["message"]

        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(STOP.rstrip())
        writer.write_eof()
        assert "newline" in json.loads(await reader.readline())["error"]["message"]
        assert await reader.read() == b""
        writer.close()

    with_socket(path, robot, scenario)
    assert robot.calls == []


def test_a_client_that_has_said_all_still_gets_the_whole_reply(tmp_path: Path) -> None:
    """As `nc -N` does: the request, end of file, and only then reading.

    Of the sizes some fit into the kernel's buffer but for a rest, which the daemon still holds
    when it has nothing left to do on that connection.
    """
    path, robot = tmp_path / "s", FakeRobot()

    async def scenario() -> None:
        for size in range(60_000, 400_000, 20_000):
            robot.maps["png"] = bytes(size)
            reader, writer = await asyncio.open_unix_connection(path, limit=1024)
            writer.write(b'{"v":1,"command":"map","arguments":{"format":"png"}}\n')
            writer.write_eof()
            for _ in range(50):  # the daemon does what it can before we read
                await asyncio.sleep(0)
            received = bytearray()
            while piece := await reader.read(65536):
                received += piece
            writer.close()
            assert len(protocol.decode_file(protocol.decode_reply(received))) == size

    with_socket(path, robot, scenario)


def test_a_refusal_of_the_robot_comes_back_by_kind(tmp_path: Path) -> None:
    path = tmp_path / "s"

    async def scenario() -> None:
        (reply,) = await ask(path, b'{"v":1,"command":"start","arguments":{"name":"again"}}\n')
        assert reply["error"]["kind"] == "StateError"
        with pytest.raises(StateError, match="a run is going on"):
            protocol.decode_reply(json.dumps(reply).encode())

    with_socket(path, FakeRobot(), scenario)


def test_a_result_that_is_no_json_is_told_and_survived(tmp_path: Path) -> None:
    path, robot = tmp_path / "s", FakeRobot()
    robot.extra_status = {"object": object()}

    async def scenario() -> None:
        first, second = await ask(path, STATUS, STOP)
        assert "internal error" in first["error"]["message"]
        assert second["ok"] is True

    with_socket(path, robot, scenario)


def test_a_bug_in_a_command_is_told_logged_and_survived(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, robot = tmp_path / "s", FakeRobot()
    robot.bug = ZeroDivisionError("oh")

    async def scenario() -> None:
        first, second = await ask(path, STATUS, STOP)
        assert "internal error" in first["error"]["message"]
        assert "ZeroDivisionError: oh" in first["error"]["message"]
        assert second["ok"] is True

    with caplog.at_level(logging.ERROR):
        with_socket(path, robot, scenario)
    assert "Traceback" in caplog.text


def test_a_slow_client_harms_nobody(tmp_path: Path) -> None:
    """One asks for a big map and does not read; others are served; it loses its connection."""
    path, robot = tmp_path / "s", FakeRobot()
    robot.maps["png"] = bytes(8_000_000)

    async def scenario() -> None:
        reader, writer = await asyncio.open_unix_connection(
            path, limit=1024
        )  # reads no further
        writer.write(b'{"v":1,"command":"map","arguments":{"format":"png"}}\n')
        for _ in range(3):
            (reply,) = await ask(path, STATUS)
            assert reply["ok"] is True
        await asyncio.wait(asyncio.all_tasks() - {asyncio.current_task()})  # it is given up on
        with contextlib.suppress(ConnectionError):
            assert len(await reader.read()) < 1_000_000
        writer.close()

    with_socket(path, robot, scenario, reply_timeout_s=0.1)
    assert ("map", "png") in robot.calls


def test_a_long_command_of_one_client_does_not_hold_up_another(tmp_path: Path) -> None:
    path, robot = tmp_path / "s", FakeRobot()

    async def scenario() -> None:
        robot.gate, robot.stopping = asyncio.Event(), asyncio.Event()
        stopping = asyncio.ensure_future(ask(path, STOP))
        await robot.stopping.wait()
        (estop,) = await ask(path, b'{"v":1,"command":"estop"}\n')
        assert estop["ok"] is True
        assert not stopping.done()
        robot.gate.set()
        assert (await stopping)[0]["result"] == "0001-run"

    with_socket(path, robot, scenario)


def test_silent_clients_are_let_go_and_too_many_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "s"

    async def scenario() -> None:
        silent = [await asyncio.open_unix_connection(path) for _ in range(CLIENTS_MAX)]
        (refused,) = await ask(path, b"")
        assert f"more than {CLIENTS_MAX} clients" in refused["error"]["message"]
        for reader, writer in silent:
            assert await reader.read() == b""  # the idle timeout has closed it
            writer.close()
        (reply,) = await ask(path, STATUS)
        assert reply["ok"] is True

    with_socket(path, FakeRobot(), scenario, idle_timeout_s=0.2)


def test_only_owner_and_group_may_connect(tmp_path: Path) -> None:
    path = tmp_path / "run" / "ins-robot" / "s"  # the directory is made

    async def scenario() -> None:
        assert stat.S_IMODE(path.stat().st_mode) == 0o660

    with_socket(path, FakeRobot(), scenario)
    assert not path.exists()


def test_closing_ends_every_connection_also_in_the_middle_of_a_command(tmp_path: Path) -> None:
    path, robot = tmp_path / "s", FakeRobot()

    async def run() -> None:
        robot.gate, robot.stopping = asyncio.Event(), asyncio.Event()
        control = ControlSocket(path, robot)
        await control.open()
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(STOP)
        await robot.stopping.wait()
        async with asyncio.timeout(5.0):
            await control.close()
            await control.close()
            with contextlib.suppress(ConnectionError):
                assert await reader.read() == b""
        writer.close()

    asyncio.run(run())
    assert not path.exists()


def test_a_stale_socket_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))  # as `kill -9` leaves it

    async def scenario() -> None:
        (reply,) = await ask(path, STATUS)
        assert reply["ok"] is True

    with_socket(path, FakeRobot(), scenario)


def test_the_socket_of_a_live_daemon_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "s"

    async def scenario() -> None:
        with pytest.raises(StateError, match="another daemon answers there"):
            await ControlSocket(path, FakeRobot()).open()
        (reply,) = await ask(path, STATUS)
        assert reply["ok"] is True

    with_socket(path, FakeRobot(), scenario)


def test_a_daemon_keeps_its_socket_s_name_also_when_somebody_removed_the_file(
    tmp_path: Path,
) -> None:
    """As between unlinking and binding: of two daemons that start at once, one must lose."""
    path = tmp_path / "s"

    async def scenario() -> None:
        path.unlink()
        with pytest.raises(StateError, match="another daemon answers there"):
            await ControlSocket(path, FakeRobot()).open()

    with_socket(path, FakeRobot(), scenario)
    with_socket(path, FakeRobot(), nothing)  # and the name is free when it has ended


async def nothing() -> None:
    pass


def test_the_socket_of_another_program_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(path))
        other.listen()
        with pytest.raises(StateError, match="another daemon answers there"):
            asyncio.run(ControlSocket(path, FakeRobot()).open())
    assert path.exists()


def test_a_file_in_the_way_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "s"
    path.write_text("precious")
    with pytest.raises(DeviceError, match="no socket is there"):
        asyncio.run(ControlSocket(path, FakeRobot()).open())
    assert path.read_text() == "precious"


def test_a_directory_that_cannot_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("")
    with pytest.raises(DeviceError, match=r"daemon\.socket"):
        asyncio.run(ControlSocket(tmp_path / "run" / "s", FakeRobot()).open())


def test_a_path_too_long_for_a_socket_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="longer than 107 bytes"):
        asyncio.run(ControlSocket(tmp_path / ("s" * 120), FakeRobot()).open())
