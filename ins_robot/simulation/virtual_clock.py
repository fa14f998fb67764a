# SPDX-License-Identifier: MIT
"""An asyncio loop whose clock jumps to the next timer as soon as nothing is left to do.

The same daemon, drivers and emulators run on it unchanged, deterministically and as fast as the
machine computes. Jobs given to an executor run inline and take no virtual time, so time never
moves while one is outstanding, and their order does not depend on threads.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class _JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting for a timer, moves the clock to it."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None:
            # Nothing is scheduled at all: only the outside can wake us.
            return super().select(None)
        if timeout > 0.0:
            self.now_s += timeout
        # The loop's own wake-up pipe is always registered; it is of interest only with others.
        return super().select(0) if len(self.get_map()) > 1 else []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop on virtual time, starting at 0 s."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._jumping.now_s

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run the job now, in this thread; the virtual clock stands still meanwhile."""
        future: asyncio.Future[T] = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # as an executor does: it belongs to who awaits the job
            future.set_exception(error)
        return future


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """`asyncio.run` on virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
