# SPDX-License-Identifier: MIT
"""The LRF outside of any run: who has it, and one scan, for `ins-robot scan`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ins_robot.config import LrfConfig
from ins_robot.daemon.pipeline import Pipeline
from ins_robot.daemon.scan_taking import ScanTaker
from ins_robot.errors import StateError
from ins_robot.messages import LaserScan


class SingleScan:
    """Borrows the LRF for one scan at a time."""

    def __init__(self, config: LrfConfig, pipeline: Pipeline) -> None:
        self._config = config
        self._pipeline = pipeline
        self._borrower: str | None = None

    def check_idle(self) -> None:
        """Refuse what needs the LRF while it is borrowed; StateError."""
        if self._borrower is not None:
            raise StateError(
                f"the LRF is busy with `ins-robot {self._borrower}`: wait a moment"
            )

    @contextmanager
    def lent_to(self, command: str) -> Iterator[None]:
        """The LRF belongs to one command; StateError while another one has it."""
        self.check_idle()
        self._borrower = command
        try:
            yield
        finally:
            self._borrower = None

    async def take(self) -> list[LaserScan]:
        """`lrf.revolutions` steady revolutions."""
        taker = ScanTaker(self._config, lambda: self._pipeline.scanner)
        taker.is_always_on = False
        revolutions: list[LaserScan] = []

        def keep(revolution: LaserScan) -> None:
            if taker.is_steady(revolution) and taker.wants(revolution):
                revolutions.append(revolution)

        with self.lent_to("scan"):
            self._pipeline.onlooker = keep
            try:
                await taker.take(self._config.revolutions, revolutions.clear)
            finally:
                self._pipeline.onlooker = None
        return revolutions
