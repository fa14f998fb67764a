# SPDX-License-Identifier: MIT
"""Text logs line by line: numbered, split, and wrong ones named by file and line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray

_SHOWN = 40
_DIGITS_MAX = 19


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a text log, in words; `is_cut` when the file ends without a line end."""

    path: Path
    number: int
    words: Sequence[str]
    is_cut: bool = False

    def error(self, what: str) -> InputError:
        """The error that says what is wrong with this line."""
        return InputError(f"{self.path}:{self.number}: {what}")

    def need(self, count: int, what: str) -> None:
        """Refuse the line when it has fewer than `count` words."""
        if len(self.words) < count:
            raise self.error(
                f"{what} has {len(self.words)} words, needs {count}; "
                "the log is cut off or damaged here: copy it again, or remove the line"
            )

    def numbers(self, start: int, stop: int) -> FloatArray:
        """Words [start, stop) as numbers (NaN and infinities as written)."""
        try:
            return np.array(self.words[start:stop], dtype=np.float64)
        except ValueError:
            wrong = next(w for w in self.words[start:stop] if not _is_number(w))
            raise self.error(f"'{wrong[:_SHOWN]}' is not a number") from None

    def finite(self, index: int, what: str) -> float:
        """One word as a finite number."""
        value = float(self.numbers(index, index + 1)[0])
        if not math.isfinite(value):
            raise self.error(f"{what} is {value}, must be finite")
        return value

    def count(self, index: int, what: str, at_most: int) -> int:
        """One word as a whole number from 1 to `at_most`."""
        word = self.words[index]
        is_whole = word.isascii() and word.isdigit() and len(word) <= _DIGITS_MAX
        if not is_whole or not 1 <= int(word) <= at_most:
            raise self.error(f"{what} is '{word[:_SHOWN]}', must be 1 to {at_most}")
        return int(word)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number, text without line end, and whether the line end is missing, of each line.

    Raises
    ------
    InputError
        If the file cannot be read or is not text.
    """
    try:
        with path.open("rb") as file:
            for number, raw in enumerate(file, start=1):
                try:
                    text = raw.decode("utf-8")
                except UnicodeDecodeError:
                    raise InputError(f"{path}:{number}: not text; is this a log?") from None
                yield number, text.rstrip("\r\n"), not raw.endswith(b"\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def split_lines(path: Path) -> Iterator[Line]:
    """Lines in words, without empty ones and `#` comments."""
    for number, text, is_cut in read_lines(path):
        words = text.split()
        if words and not words[0].startswith("#"):
            yield Line(path, number, words, is_cut)
