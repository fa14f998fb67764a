# SPDX-License-Identifier: MIT
"""The client's end of the control socket: one request, one reply, blocking, stdlib only.

What the daemon refuses is raised here as the error it was there.
"""

from __future__ import annotations

import argparse
import socket
import time
from pathlib import Path
from typing import Any

from ins_robot.cli.config_source import load_config
from ins_robot.config import DaemonConfig
from ins_robot.daemon import control_protocol as protocol
from ins_robot.errors import StateError

CONNECT_TIMEOUT_S = 5.0
REPLY_TIMEOUT_S = 15.0
SLOW_REPLY_TIMEOUTS_S = {  # these draw a picture or take a scan; a Pi 3 takes its time
    "stop": 240.0,
    "goto": 60.0,
    "add_zone": 60.0,
    "remove_zone": 60.0,
    "map": 180.0,
    "next_picture": 60.0,
    "here": 120.0,
    "skip": 60.0,
    "scan": 120.0,
}


def _remedy(path: Path) -> str:
    """What to do when the daemon does not answer; the service is the one of the defaults."""
    if str(path) == DaemonConfig().socket:
        return (
            "systemctl status ins-robot; of another configuration: --config F or "
            "INS_ROBOT_CONFIG"
        )
    return "start `ins-robot daemon` with this configuration"


def request(args: argparse.Namespace, command: str, **arguments: Any) -> Any:
    """Ask the daemon of the configuration in `args`; its answer."""
    path = Path(load_config(args).daemon.socket)
    timeout_s = SLOW_REPLY_TIMEOUTS_S.get(command, REPLY_TIMEOUT_S)
    return ask(path, protocol.Request(command=command, arguments=arguments), timeout_s)


def ask(path: Path, wanted: protocol.Request, timeout_s: float = REPLY_TIMEOUT_S) -> Any:
    """Send one request to the socket at `path` and return the result in the reply.

    Raises
    ------
    StateError
        When nobody answers there, or not in time.
    RobotError
        What the daemon refused the request with.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        try:
            connection.settimeout(CONNECT_TIMEOUT_S)
            connection.connect(str(path))
            connection.sendall(protocol.encode_request(wanted))
            line = _read_line(connection, timeout_s)
        except TimeoutError:
            raise StateError(
                f"the daemon at {path} did not answer '{wanted.command}' within "
                f"{timeout_s:g} s: busy or hung? see its log"
            ) from None
        except PermissionError:
            raise StateError(
                f"{path}: this user may not command the robot; "
                "join the group of the socket, or use sudo"
            ) from None
        except OSError:
            raise StateError(
                f"no daemon answers at {path}: is it running? {_remedy(path)}"
            ) from None
    if not line:
        raise StateError(f"the daemon at {path} hung up: see its log")
    return protocol.decode_reply(line)


def _read_line(connection: socket.socket, timeout_s: float) -> bytes:
    """The reply without its newline; b"" when the daemon hung up before its end."""
    deadline_s = time.monotonic() + timeout_s
    received = bytearray()
    while not received.endswith(b"\n"):
        connection.settimeout(max(1e-3, deadline_s - time.monotonic()))
        chunk = connection.recv(1 << 18)
        if not chunk or len(received) > protocol.REPLY_MAX_BYTES:
            return b""
        received += chunk
        if time.monotonic() > deadline_s:
            raise TimeoutError
    return bytes(received)
