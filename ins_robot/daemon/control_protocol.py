# SPDX-License-Identifier: MIT
"""What is said on the control socket: requests and replies, one JSON object a line.

A request names a command of `RobotCommands` and its arguments; the reply carries the result, or
the kind and message of an error. docs/protocols.md describes the bytes. Light on purpose: the
command line imports this file, so it imports neither asyncio nor numpy.
"""

from __future__ import annotations

import base64
import binascii
import difflib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from ins_robot import errors
from ins_robot.errors import RobotError, StateError, WireError

VERSION = 1
REQUEST_MAX_BYTES = 64 * 1024
REPLY_MAX_BYTES = 64 * 1024 * 1024
MAP_FORMATS = ("png", "pgm", "yaml")


class RobotCommands(Protocol):
    """What a client may ask of the daemon; a refusal is a RobotError, mostly a StateError.

    Commands of several clients may overlap: `estop` comes in while `stop` still saves the map.
    """

    async def start(self, name: str) -> str:
        """Begin a run; `name` may be "". Returns the run's name, e.g. "0007-lab"."""
        ...

    async def stop(self) -> str:
        """End the run and save its map. Returns the run's name."""
        ...

    async def pause(self) -> None:
        """Stand still."""
        ...

    async def resume(self) -> None:
        """Go on after `pause`."""
        ...

    async def estop(self) -> None:
        """Stop the motors now, latched. Works in every state."""
        ...

    async def clear(self) -> None:
        """Release the emergency stop and latched faults."""
        ...

    async def status(self) -> dict[str, Any]:
        """JSON values by name; "state" is always there."""
        ...

    async def map(self, format: str) -> bytes:
        """The running map, else the last finished one, as a file of `MAP_FORMATS`."""
        ...

    async def next(self) -> dict[str, Any]:
        """Where the run goes next (`directions.directions`)."""
        ...

    async def next_picture(self) -> bytes:
        """The same on the map, a PNG."""
        ...

    async def here(self) -> dict[str, Any]:
        """Manual base: scan where the LRF was put down; what `next` says then."""
        ...

    async def skip(self) -> dict[str, Any]:
        """Manual base: the place cannot be reached; what `next` says then."""
        ...

    async def scan(self) -> bytes:
        """Take one scan outside of the run; its polar plot, a PNG."""
        ...

    async def goto(self, x_m: float, y_m: float) -> None:
        """Drive to a place of the map; returns when the robot sets out."""
        ...

    async def zones(self) -> list[dict[str, Any]]:
        """The no-go zones and virtual walls (`Zone.as_json`)."""
        ...

    async def add_zone(self, zone: dict[str, Any]) -> None:
        """Forbid ground from now on."""
        ...

    async def remove_zone(self, name: str) -> None:
        """Allow it again."""
        ...

    async def runs(self) -> list[dict[str, Any]]:
        """The recorded runs, oldest first (`run_store.RunInfo.as_dict`)."""
        ...

    async def delete_runs(self, names: list[str]) -> None:
        """Remove recorded runs: all of `names`, or none and an error."""
        ...


# The arguments of every command and their types; nothing else is accepted.
ARGUMENTS: dict[str, dict[str, type]] = {
    "start": {"name": str},
    "stop": {},
    "pause": {},
    "resume": {},
    "estop": {},
    "clear": {},
    "status": {},
    "map": {"format": str},
    "next": {},
    "next_picture": {},
    "here": {},
    "skip": {},
    "scan": {},
    "goto": {"x_m": float, "y_m": float},
    "zones": {},
    "add_zone": {"zone": dict},
    "remove_zone": {"name": str},
    "runs": {},
    "delete_runs": {"names": list},
}

KINDS = {str: "a string", list: "a list of strings", float: "a number", dict: "an object"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One command with its arguments, all present and of the declared types."""

    command: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


def encode_request(request: Request) -> bytes:
    """The request as one line."""
    body = {"v": VERSION, "command": request.command, "arguments": dict(request.arguments)}
    return _line(body)


def decode_request(line: bytes) -> Request:
    """Read a request line. Raises WireError that tells the client what is wrong with it."""
    body = _object(line, "request")
    command, arguments = body.get("command"), body.get("arguments", {})
    if not isinstance(command, str) or command not in ARGUMENTS:
        close = difflib.get_close_matches(str(command), ARGUMENTS, n=1)
        hint = f"; did you mean '{close[0]}'?" if close else f"; known: {', '.join(ARGUMENTS)}"
        raise WireError(f"control request: unknown command {json.dumps(command)}{hint}")
    if not isinstance(arguments, dict):
        raise WireError(f"control request '{command}': 'arguments' must be an object")
    wanted = ARGUMENTS[command]
    for name in arguments:
        if name not in wanted:
            raise WireError(f"control request '{command}': unknown argument '{name}'")
    for name, kind in wanted.items():
        if not _is_a(arguments.get(name), kind):
            what = KINDS[kind]
            raise WireError(f"control request '{command}': argument '{name}' must be {what}")
    return Request(command=command, arguments=arguments)


def _is_a(value: Any, kind: type) -> bool:
    if kind is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and math.isfinite(value)
    if kind is list:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)
    return isinstance(value, kind)


async def dispatch(request: Request, commands: RobotCommands) -> Any:
    """Carry out a request; the result is a JSON value (bytes of files as base64 text)."""
    if request.command == "map":
        wanted = request.arguments["format"]
        if wanted not in MAP_FORMATS:
            raise WireError(f"map format '{wanted}': must be one of {', '.join(MAP_FORMATS)}")
    result = await getattr(commands, request.command)(**request.arguments)
    return base64.b64encode(result).decode("ascii") if isinstance(result, bytes) else result


def encode_result(result: Any) -> bytes:
    """The reply to a request that was carried out."""
    return _line({"v": VERSION, "ok": True, "result": _finite(result)})


def encode_error(error: RobotError) -> bytes:
    """The reply to a request that was refused or failed."""
    return _line(
        {
            "v": VERSION,
            "ok": False,
            "error": {"kind": type(error).__name__, "message": str(error)},
        }
    )


def decode_reply(line: bytes) -> Any:
    """The result in a reply line; an error in it is raised as it was in the daemon."""
    body = _object(line, "reply")
    if body.get("ok") is True:
        return body.get("result")
    error = body.get("error")
    if not isinstance(error, dict):
        raise WireError("control reply: neither a result nor an error")
    kind = getattr(errors, str(error.get("kind")), None)
    if not (isinstance(kind, type) and issubclass(kind, RobotError)):
        kind = StateError
    raise kind(str(error.get("message")))


def decode_file(result: Any) -> bytes:
    """The bytes of the file in the result of `map`, `next_picture` or `scan`."""
    try:
        return base64.b64decode(result, validate=True)
    except (TypeError, ValueError, binascii.Error):
        raise WireError("control reply: the file is not base64 text") from None


def _finite(value: Any) -> Any:
    """The same value with null for NaN and infinity, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _line(body: dict[str, Any]) -> bytes:
    return json.dumps(body, allow_nan=False, separators=(",", ":")).encode() + b"\n"


def _object(line: bytes, what: str) -> dict[str, Any]:
    try:
        body = json.loads(line)
    except (ValueError, RecursionError):
        raise WireError(f"control {what}: not a line of JSON") from None
    if not isinstance(body, dict):
        raise WireError(f"control {what}: must be a JSON object")
    if body.get("v") != VERSION:
        raise WireError(
            f"control {what}: protocol version {json.dumps(body.get('v'))}, this side speaks "
            f"{VERSION}: command line and daemon are of different releases; restart the daemon"
        )
    return body
