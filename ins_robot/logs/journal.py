# SPDX-License-Identifier: MIT
"""The recording of a run: every message in the order in which it entered the core.

`JournalWriter.write` only queues (it is called from the event loop); `flush`, about once a
second and on another thread, encodes, writes and syncs: a power cut costs what came after the
last flush. `read_journal` skips damaged stretches and says how many bytes were lost where.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

from ins_robot.errors import InputError, StateError, WireError
from ins_robot.logs.journal_codec import (
    FORMAT_VERSION,
    MAGIC,
    OVERHEAD,
    JournalHeader,
    Message,
    Record,
    RecordKind,
    decode_header,
    decode_message,
    encode_header,
    encode_message,
    find_record,
)
from ins_robot.messages import Mark

JOURNAL_NAME = "run.journal"

__all__ = [
    "JOURNAL_NAME",
    "Journal",
    "JournalHeader",
    "JournalLoss",
    "JournalMessages",
    "JournalWriter",
    "Message",
    "is_journal",
    "read_journal",
]


class Journal(Protocol):
    """Where a run's messages go."""

    def write(self, message: Message) -> None:
        """Take one message."""

    def flush(self) -> None:
        """Nothing taken so far can be lost after this."""

    def close(self) -> None:
        """No message comes after this."""


class JournalWriter:
    """Writes one journal; a context manager. `write` is for one thread, `flush` for any."""

    def __init__(self, path: Path, header: JournalHeader) -> None:
        """Create (or replace) the file and write the header at once."""
        self._pending: deque[Message | bytes] = deque()
        self._flushing = threading.Lock()
        self._unwritten = bytearray()
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        self._pending.append(MAGIC + encode_header(header))
        self.flush()

    def write(self, message: Message) -> None:
        """Queue one message; nothing is encoded or written yet."""
        if self._file.closed:
            raise StateError(f"{self._file.name}: the journal is closed")
        # Messages are frozen and can wait; a Mark's payload is a dict its owner may change.
        self._pending.append(encode_message(message) if isinstance(message, Mark) else message)

    def flush(self) -> None:
        """Encode and write what is queued, and wait until the disk has it.

        Raises
        ------
        InputError
            When the disk is full or broken; what is not written yet stays queued.
        """
        with self._flushing:
            unwritten = self._unwritten
            while self._pending:
                record = self._pending.popleft()
                unwritten += record if isinstance(record, bytes) else encode_message(record)
            if not unwritten:
                return
            try:
                while unwritten:
                    del unwritten[: os.write(self._file.fileno(), unwritten)]
                os.fsync(self._file.fileno())
            except OSError as error:
                raise InputError(
                    f"{self._file.name}: the recording cannot be written: {error.strerror}"
                ) from None

    def close(self) -> None:
        """Flush and close; may be called again."""
        if not self._file.closed:
            try:
                self.flush()
            finally:
                self._file.close()

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalLoss:
    """A stretch of the file that holds no sound record."""

    offset: int
    length: int
    is_tail: bool

    def __str__(self) -> str:
        """Say it in words."""
        where = "at the end (cut off)" if self.is_tail else "in the middle (damaged)"
        return f"{self.length} bytes lost at offset {self.offset}, {where}"


class JournalMessages:
    """Iterates over the messages of a journal; `losses` fills up on the way."""

    def __init__(self, data: bytes, offset: int, where: str) -> None:
        self._data, self._offset, self._where = data, offset, where
        self.losses: list[JournalLoss] = []

    @property
    def progress(self) -> float:
        """Share of the file read so far, 0 to 1."""
        return self._offset / len(self._data)

    def __iter__(self) -> Iterator[Message]:
        return self

    def __next__(self) -> Message:
        record = find_record(self._data, self._offset) or self._resync()
        try:
            message = decode_message(record.kind, self._data[record.start : record.stop])
        except WireError as error:
            raise InputError(
                f"{self._where}: at offset {self._offset}: {error}; written by another version?"
            ) from None
        self._offset = record.end
        return message

    def _resync(self) -> Record:
        """Skip to the next sound record, or end the iteration; note what was lost."""
        lost_from, size = self._offset, len(self._data)
        for offset in range(lost_from + 1, size - OVERHEAD + 1):
            record = find_record(self._data, offset)
            if record is not None:
                self._note(lost_from, offset, is_tail=False)
                self._offset = offset
                return record
        if lost_from < size:
            self._note(lost_from, size, is_tail=True)
        self._offset = size
        raise StopIteration

    def _note(self, start: int, stop: int, *, is_tail: bool) -> None:
        self.losses.append(JournalLoss(offset=start, length=stop - start, is_tail=is_tail))


def is_journal(path: Path) -> bool:
    """Whether the file begins like a journal."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def read_journal(path: Path) -> tuple[JournalHeader, JournalMessages]:
    """Open a journal: its header, and its messages in the order in which they were written.

    Raises
    ------
    InputError
        If the file is no journal, of another format, or damaged in its header.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.startswith(MAGIC):
        raise InputError(
            f"{path}: not a journal of ins-robot (it does not begin with INS-JRNL)"
        )
    record = find_record(data, len(MAGIC))
    if record is None or record.kind is not RecordKind.HEADER:
        raise InputError(
            f"{path}: the header of the journal is damaged or cut off ({len(data)} bytes); "
            "without its configuration the run cannot be replayed"
        )
    try:
        header = decode_header(data[record.start : record.stop])
    except WireError as error:
        raise InputError(f"{path}: {error}") from None
    if header.format_version != FORMAT_VERSION:
        raise InputError(
            f"{path}: journal format {header.format_version}, this version reads "
            f"{FORMAT_VERSION}; replay it with ins-robot {header.package_version}"
        )
    return header, JournalMessages(data, record.end, str(path))
