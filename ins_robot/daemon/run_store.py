# SPDX-License-Identifier: MIT
"""The directory of recorded runs: one subdirectory each, `0007-lab`, by counter and name.

A Pi has no clock, so runs are counted; the counter has a file of its own and a number is never
given twice, also not after deletion or a crash. A run without summary.json was interrupted.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ins_robot.errors import InputError, StateError

COUNTER_FILE = ".counter"
TRASH_PREFIX = ".deleted-"
SUMMARY_FILE = "summary.json"
DEFAULT_NAME = "run"
NAME_MAX_LENGTH = 64
BYTES_PER_MB = 1e6

_RUN_NAME = re.compile(r"(\d{4,9})-([A-Za-z0-9_-]+)", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInfo:
    """What is known of a run from its directory; None where its summary does not tell.

    `state` is what the summary says ("complete", "stopped", "failed"), else "running", or
    "interrupted" when it ended without a summary.
    """

    name: str
    state: str
    reason: str = ""
    duration_s: float | None = None
    path_length_m: float | None = None
    scans: int | None = None
    size_mb: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """JSON values by name."""
        return {
            "name": self.name,
            "state": self.state,
            "reason": self.reason,
            "duration_s": self.duration_s,
            "path_length_m": self.path_length_m,
            "scans": self.scans,
            "size_mb": self.size_mb,
        }


class RunStore:
    """Runs under `root`; at most `keep_runs` are kept (0: all)."""

    def __init__(self, root: Path, *, keep_runs: int = 0, keep_free_mb: int = 0) -> None:
        self.root = root
        self._keep_runs = keep_runs
        self._keep_free_mb = keep_free_mb

    def open(self) -> None:
        """Make the directory, and see that it can be written; before any run needs it."""
        probe = self.root / f".probe.{os.getpid()}"
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise InputError(
                f"daemon.runs = {self.root}: cannot be written: {error.strerror}; name a "
                "directory that this user may write"
            ) from None

    def create(self, name: str = "") -> Path:
        """A new empty run directory. Older runs beyond `keep_runs` are removed first.

        Raises
        ------
        StateError
            When the disk has less than `keep_free_mb` free.
        InputError
            When the directory cannot be written.
        """
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            self._empty_trash()
            if self._keep_runs:
                self._prune(self._keep_runs - 1)
            self._check_free_space()
            number = self._next_number()
            path = self.root / f"{number:04d}-{sanitised(name)}"
            path.mkdir()
            _sync_directory(self.root)
        except OSError as error:
            raise InputError(
                f"daemon.runs = {self.root}: no run can be created: {error.strerror}"
            ) from None
        return path

    def path(self, name: str) -> Path:
        """The directory of the run called `name`. Raises InputError when there is none."""
        path = self.root / name
        if _number(name) is None or not _is_run(path):
            raise InputError(f"no run '{name}' in {self.root}; `ins-robot runs` lists them")
        return path

    def names(self) -> list[str]:
        """The names of all runs, oldest first."""
        if not self.root.is_dir():
            return []
        runs = [
            p.name for p in self.root.iterdir() if _number(p.name) is not None and _is_run(p)
        ]
        return sorted(runs, key=lambda name: (_number(name) or 0, name))

    def infos(self, current: str | None = None) -> list[RunInfo]:
        """What is known of every run, oldest first; `current` names the one being recorded."""
        return [_info(self.root / name, is_running=name == current) for name in self.names()]

    def latest_with(self, filename: str) -> Path | None:
        """The newest file of that name in any run; None when no run has one."""
        paths = (self.root / name / filename for name in reversed(self.names()))
        return next((path for path in paths if path.is_file()), None)

    def delete(self, names: Iterable[str], current: str | None = None) -> None:
        """Remove runs: all that are named, or none when one of them cannot be."""
        paths = [self.path(name) for name in dict.fromkeys(names)]
        if any(path.name == current for path in paths):
            raise StateError(
                f"run '{current}' is being recorded: `ins-robot stop` ends it first"
            )
        self._remove(paths)

    def prune(self, current: str | None = None) -> list[str]:
        """Remove the oldest runs beyond `keep_runs`, never `current`; the names removed."""
        self._empty_trash()
        return self._prune(self._keep_runs, current) if self._keep_runs else []

    def _prune(self, keep: int, current: str | None = None) -> list[str]:
        names = self.names()
        old = [name for name in names[: max(0, len(names) - keep)] if name != current]
        self._remove([self.root / name for name in old])
        return old

    def _remove(self, paths: Iterable[Path]) -> None:
        # Renamed first: a crash halfway leaves no run that lacks some of its files.
        for path in paths:
            trash = self.root / (TRASH_PREFIX + path.name)
            shutil.rmtree(trash, ignore_errors=True)
            try:
                path.rename(trash)
                shutil.rmtree(trash)
            except OSError as error:
                raise InputError(f"{path}: cannot be removed: {error.strerror}") from None

    def _empty_trash(self) -> None:
        if self.root.is_dir():
            for path in self.root.glob(TRASH_PREFIX + "*"):
                shutil.rmtree(path, ignore_errors=True)

    def _check_free_space(self) -> None:
        free_mb = shutil.disk_usage(self.root).free / BYTES_PER_MB
        if free_mb < self._keep_free_mb:
            raise StateError(
                f"{self.root}: {free_mb:.0f} MB free, daemon.keep_free_mb = "
                f"{self._keep_free_mb}: "
                "remove old runs with `ins-robot runs delete NAME...`"
            )

    def _next_number(self) -> int:
        """Count up, on disk before the number is used. A lost or torn file costs nothing."""
        counter = self.root / COUNTER_FILE
        try:
            last = int(counter.read_text(encoding="ascii"))
        except (FileNotFoundError, ValueError):
            last = 0
        number = max(last, *(_number(name) or 0 for name in self.names()), 0) + 1
        temporary = counter.with_suffix(".new")
        with temporary.open("w", encoding="ascii") as file:
            file.write(f"{number}\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(counter)
        return number


def sanitised(name: str) -> str:
    """The name with letters, digits, "-" and "_" only; other characters become "-"."""
    clean = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-")
    return clean[:NAME_MAX_LENGTH].strip("-") or DEFAULT_NAME


def _number(name: str) -> int | None:
    match = _RUN_NAME.fullmatch(name)
    return int(match[1]) if match else None


def _is_run(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _info(path: Path, *, is_running: bool) -> RunInfo:
    size_mb = round(sum(_size(file) for file in path.iterdir()) / BYTES_PER_MB, 3)
    if is_running:
        return RunInfo(name=path.name, state="running", size_mb=size_mb)
    try:
        summary = json.loads((path / SUMMARY_FILE).read_bytes())
    except (OSError, ValueError):
        summary = None
    if not isinstance(summary, dict) or not isinstance(summary.get("state"), str):
        return RunInfo(name=path.name, state="interrupted", size_mb=size_mb)
    scans = _number_of(summary, "scans")
    return RunInfo(
        name=path.name,
        state=summary["state"],
        reason=str(summary.get("reason", "")),
        duration_s=_number_of(summary, "duration_s"),
        path_length_m=_number_of(summary, "path_length_m"),
        scans=None if scans is None else int(scans),
        size_mb=size_mb,
    )


def _number_of(summary: dict[str, Any], key: str) -> float | None:
    value = summary.get(key)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # gone since it was listed
        return 0


def _sync_directory(path: Path) -> None:
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
