# SPDX-License-Identifier: MIT
"""The daemon's end of the control socket: an asyncio server on a Unix socket.

Requests in, replies out, one JSON line each (`control_protocol`), in order per connection and
at once between connections. A slow, silent or broken client loses its own connection only.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import logging
import os
import socket
import stat
from pathlib import Path

from ins_robot.daemon import control_protocol as protocol
from ins_robot.daemon.supervisor import outcome_of
from ins_robot.errors import DeviceError, RobotError, StateError, WireError

log = logging.getLogger(__name__)

CLIENTS_MAX = 16
IDLE_TIMEOUT_S = 60.0  # for the next whole request
REPLY_TIMEOUT_S = 30.0  # for the client to take a reply; a map over a slow ssh link fits
SOCKET_MODE = 0o660  # owner and group; the group is who may drive the robot
PATH_MAX_BYTES = 107  # sun_path of Linux, less the final NUL


class ControlSocket:
    """Serves `RobotCommands` on a Unix socket: `await open()`, later `await close()`."""

    def __init__(
        self,
        path: Path,
        commands: protocol.RobotCommands,
        *,
        idle_timeout_s: float = IDLE_TIMEOUT_S,
        reply_timeout_s: float = REPLY_TIMEOUT_S,
    ) -> None:
        self.path = path
        self._commands = commands
        self._idle_timeout_s = idle_timeout_s
        self._reply_timeout_s = reply_timeout_s
        self._server: asyncio.Server | None = None
        self._lock_fd = -1
        self._inode = 0
        self._connections: set[asyncio.Task[None]] = set()

    async def open(self) -> None:
        """Listen. Raises StateError when another daemon listens there, else DeviceError."""
        try:
            self._lock_fd = _take_lock(self.path)
            listener = _listener(self.path)
        except OSError as error:
            self._drop_lock()
            if isinstance(error, RobotError):
                raise
            raise DeviceError(
                f"control socket {self.path}: {error.strerror}; "
                "daemon.socket must lie in a directory this user may write"
            ) from None
        except StateError:
            self._drop_lock()
            raise
        self._inode = self.path.stat().st_ino
        self._server = await asyncio.start_unix_server(
            self._serve, sock=listener, limit=protocol.REQUEST_MAX_BYTES
        )
        log.info("control socket: listening on %s", self.path)

    async def close(self) -> None:
        """Stop listening, end every connection, remove the socket; may be called again."""
        server, self._server = self._server, None
        if server is None:
            return
        server.close()
        connections = list(self._connections)
        for task in connections:
            task.cancel()
        await asyncio.gather(*connections, return_exceptions=True)
        await server.wait_closed()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._inode:  # not one that another daemon made since
                self.path.unlink()
        self._drop_lock()

    def _drop_lock(self) -> None:
        if self._lock_fd >= 0:
            os.close(self._lock_fd)
            self._lock_fd = -1

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._connections.add(task)
        try:
            if len(self._connections) > CLIENTS_MAX:
                await self._reply(writer, _error(f"more than {CLIENTS_MAX} clients at a time"))
            else:
                while line := await self._next_line(reader, writer):
                    await self._reply(writer, await self._answer(line))
            async with asyncio.timeout(self._reply_timeout_s):
                writer.close()  # what is still in the buffer goes out first
                await writer.wait_closed()
        except TimeoutError:
            log.debug("control socket: a client was too slow and is disconnected")
        except (ConnectionError, asyncio.CancelledError):
            pass  # gone, or we are closing: nobody is left to tell
        finally:
            self._connections.discard(task)
            writer.transport.abort()

    async def _next_line(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> bytes:
        """The next request with its newline; b"" when there is none to come."""
        try:
            async with asyncio.timeout(self._idle_timeout_s):
                return await reader.readuntil(b"\n")
        except asyncio.IncompleteReadError as error:
            if error.partial:
                await self._reply(writer, _error("the request does not end with a newline"))
        except asyncio.LimitOverrunError:
            limit = protocol.REQUEST_MAX_BYTES
            await self._reply(writer, _error(f"the request is longer than {limit} bytes"))
        return b""

    async def _answer(self, line: bytes) -> bytes:
        try:
            request = protocol.decode_request(line)
        except WireError as error:
            return protocol.encode_error(error)
        outcome = await outcome_of(self._carry_out(request), f"command '{request.command}'")
        return protocol.encode_error(outcome) if isinstance(outcome, RobotError) else outcome

    async def _carry_out(self, request: protocol.Request) -> bytes:
        return protocol.encode_result(await protocol.dispatch(request, self._commands))

    async def _reply(self, writer: asyncio.StreamWriter, reply: bytes) -> None:
        async with asyncio.timeout(self._reply_timeout_s):
            # Small pieces with a drain each: the buffer of a slow client stays small too.
            for start in range(0, len(reply), protocol.REQUEST_MAX_BYTES):
                writer.write(reply[start : start + protocol.REQUEST_MAX_BYTES])
                await writer.drain()


def _error(message: str) -> bytes:
    return protocol.encode_error(WireError(f"control request: {message}"))


def _take_lock(path: Path) -> int:
    """Hold PATH.lock for the life of the daemon: of two that start at once, one wins."""
    if len(os.fsencode(path)) > PATH_MAX_BYTES:
        raise DeviceError(
            f"control socket {path}: path longer than {PATH_MAX_BYTES} bytes, the limit for "
            "Unix sockets; choose a shorter daemon.socket"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    fd = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(fd)
        raise _already_running(path) from None
    return fd


def _listener(path: Path) -> socket.socket:
    """A bound socket at `path`. A stale one is removed, a live one or another file is not."""
    if os.path.lexists(path):
        _remove_stale(path)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
        path.chmod(SOCKET_MODE)  # before listen(): until then nobody can connect
    except OSError:
        listener.close()
        raise
    return listener


def _remove_stale(path: Path) -> None:
    if not stat.S_ISSOCK(path.lstat().st_mode):
        raise DeviceError(
            f"control socket {path}: a file that is no socket is there; remove it, or choose "
            "another daemon.socket"
        )
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except BlockingIOError:
            pass  # somebody listens, with a full queue
    raise _already_running(path)


def _already_running(path: Path) -> StateError:
    return StateError(
        f"control socket {path}: another daemon answers there; stop it first "
        "(systemctl stop ins-robot), or give this one another daemon.socket"
    )
