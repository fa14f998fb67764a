# SPDX-License-Identifier: MIT
"""What kind of log a path holds, told by its content and never by its name."""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path

from ins_robot.errors import InputError
from ins_robot.logs import botvac, carmen, lego
from ins_robot.logs.journal import JOURNAL_NAME, is_journal
from ins_robot.logs.sensor_log import SensorLog

_LINES_LOOKED_AT = 200
_LINE_BYTES = 64_000


class LogKind(Enum):
    """The kinds that `replay` knows."""

    JOURNAL = "a recording of ins-robot"
    CARMEN = "a CARMEN log"
    BOTVAC = "a Botvac recording (CSV)"
    LEGO = "the LEGO robot's directory"


def find_log(path: Path) -> tuple[LogKind, Path]:
    """The kind of log at `path`, and the file (or directory) that holds it.

    Raises
    ------
    InputError
        If there is nothing, nothing readable, or nothing known.
    """
    try:
        if path.is_dir():
            return _find_in_directory(path)
        kind = _kind_of_file(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such log") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if kind is LogKind.LEGO:
        raise InputError(
            f"{path}: one file of the LEGO robot; give its directory {path.parent}"
        )
    if kind is None:
        known = ", ".join(kind.value for kind in LogKind)
        raise InputError(f"{path}: not a log that is known here: {known}")
    return kind, path


def _find_in_directory(path: Path) -> tuple[LogKind, Path]:
    journal = path / JOURNAL_NAME
    if journal.exists():
        return LogKind.JOURNAL, journal
    files = sorted(p for p in path.glob("*.txt") if p.is_file())
    if any(_kind_of_file(file) is LogKind.LEGO for file in files):
        return LogKind.LEGO, path
    raise InputError(
        f"{path}: a directory without {JOURNAL_NAME} and without the LEGO robot's files; "
        "give the log's file"
    )


def _kind_of_file(path: Path) -> LogKind | None:
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    if is_journal(path):
        return LogKind.JOURNAL
    with path.open("rb") as file:
        for _ in range(_LINES_LOOKED_AT):
            line = file.readline(_LINE_BYTES)
            if not line:
                break
            kind = _kind_of_line(line.decode("utf-8", errors="replace").strip())
            if kind is not None:
                return kind
    return None


def _kind_of_line(text: str) -> LogKind | None:
    word = text.split(maxsplit=1)[0] if text else ""
    if word in carmen.WORDS:
        return LogKind.CARMEN
    if word in {"S", "M", "P"}:
        return LogKind.LEGO
    if text.startswith('"') and text.split(",")[0].strip('"') in botvac.NAMES:
        return LogKind.BOTVAC
    return None


def read_log(kind: LogKind, path: Path, fov_deg: float | None = None) -> SensorLog:
    """Read a foreign log (not a journal); `fov_deg` is for CARMEN's `FLASER` lines."""
    match kind:
        case LogKind.CARMEN:
            return carmen.read_carmen(path, None if fov_deg is None else math.radians(fov_deg))
        case LogKind.BOTVAC:
            return botvac.read_botvac(path)
        case LogKind.LEGO:
            return lego.read_lego(path)
        case LogKind.JOURNAL:
            raise InputError(f"{path}: a recording of ins-robot is read by read_journal")
