# SPDX-License-Identifier: MIT
"""Ctrl-C and SIGTERM during long work: both end it, and what there is by then is kept."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any


class Interrupts:
    """Within `with`, the first of either signal sets `is_set`; the next one is Ctrl-C again.

    `has_cut`: work has been cut short for it, by `cut`; otherwise it came too late to matter.
    """

    def __init__(self) -> None:
        self.is_set = False
        self.has_cut = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def cut(self) -> bool:
        """Asked before each further piece of work; True: there was a signal, so stop here."""
        self.has_cut = self.is_set
        return self.has_cut

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self.is_set = True


class TerminateAsInterrupt:
    """Within `with`, SIGTERM is Ctrl-C, whatever that does there."""

    def __enter__(self) -> None:
        self._before = signal.signal(
            signal.SIGTERM, lambda number, frame: signal.raise_signal(signal.SIGINT)
        )

    def __exit__(self, *error: object) -> None:
        signal.signal(signal.SIGTERM, self._before)
