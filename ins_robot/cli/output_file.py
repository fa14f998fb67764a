# SPDX-License-Identifier: MIT
"""Output files of commands: whole or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from ins_robot.errors import InputError


def check_output(path: Path | None, command: str, kind: str) -> None:
    """Refuse to print a binary file on a terminal, before the work is done."""
    if path is None and sys.stdout.isatty():
        raise InputError(
            f"{command}: a {kind} is binary and stdout is a terminal; "
            f"use `-o FILE` or redirect: `ins-robot {command} > {command}.png`"
        )


def deliver(content: bytes, path: Path | None) -> None:
    """Write a file to `path`, or to stdout when there is none."""
    if path is None:
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()
    else:
        write_whole(path, content)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file beside its final name and move it there: never a half-written one.

    What is there and is no regular file (/dev/stdout, a pipe) is written to directly.
    """
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
            return
        fd, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        temporary = Path(name)
        try:
            with os.fdopen(fd, "wb") as file:
                file.write(content)
            temporary.chmod(0o666 & ~_umask())  # mkstemp makes it private
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
