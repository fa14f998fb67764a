# SPDX-License-Identifier: MIT
"""How the daemon logs: to stderr, one line a record, with times unless the journal adds them.

`set_up` at the start, then `banner`: version, host and the whole configuration, so that a log
file is self-sufficient.
"""

from __future__ import annotations

import dataclasses
import logging
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from ins_robot import __version__
from ins_robot.config import Config, to_toml

PLAIN_FORMAT = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
JOURNAL_FORMAT = "<%(priority)d>%(name)s: %(message)s"
PACKAGE_PREFIX = "ins_robot."


class _Formatter(logging.Formatter):
    """Short logger names, one line a message, and the priority prefix that journald reads."""

    def format(self, record: logging.LogRecord) -> str:
        shown = logging.makeLogRecord(record.__dict__)
        shown.name = record.name.removeprefix(PACKAGE_PREFIX)
        shown.msg = record.getMessage().replace("\n", " | ")
        shown.args = None
        shown.priority = _priority(record.levelno)
        return super().format(shown)


def set_up(
    level: str, stream: IO[str] | None = None, environment: Mapping[str, str] = os.environ
) -> None:
    """Send all records from `level` ("debug" ... "error") on to `stream` (default: stderr).

    Calling it again replaces what the last call set.
    """
    handler = logging.StreamHandler(stream or sys.stderr)
    is_journal = "JOURNAL_STREAM" in environment  # set by systemd, which adds the time itself
    handler.setFormatter(_Formatter(JOURNAL_FORMAT if is_journal else PLAIN_FORMAT))
    root = logging.getLogger()
    for old in list(root.handlers):
        if isinstance(old.formatter, _Formatter):
            root.removeHandler(old)
    root.addHandler(handler)
    root.setLevel(level.upper())
    logging.captureWarnings(capture=True)


def banner(log: logging.Logger, config: Config, config_path: Path | None) -> None:
    """Log what runs here and with which configuration."""
    log.info(
        "ins-robot %s, Python %s, %s %s",
        __version__,
        platform.python_version(),
        platform.system(),
        platform.machine(),
    )
    log.info("configuration: %s", config_path or "defaults")
    for section in to_toml(config).strip().split("\n\n"):
        head, *options = section.splitlines()
        log.info("%s %s", head, ", ".join(options))
    changed = _changed(config)
    log.info("other than the defaults: %s", ", ".join(changed) or "nothing")


def _changed(config: Config) -> list[str]:
    default = Config()
    return [
        f"{section.name}.{f.name}"
        for section in dataclasses.fields(config)
        for f in dataclasses.fields(getattr(config, section.name))
        if getattr(getattr(config, section.name), f.name)
        != getattr(getattr(default, section.name), f.name)
    ]


def _priority(level: int) -> int:
    """The syslog priority of a logging level (sd-daemon(3))."""
    for bound, priority in (
        (logging.CRITICAL, 2),
        (logging.ERROR, 3),
        (logging.WARNING, 4),
        (logging.INFO, 6),
    ):
        if level >= bound:
            return priority
    return 7
