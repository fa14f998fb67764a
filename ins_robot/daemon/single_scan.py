# SPDX-License-Identifier: MIT
"""One scan outside of any run, for `ins-robot scan`."""

from __future__ import annotations

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

    def check_idle(self) -> None:
        """Refuse what needs the LRF while it is borrowed; StateError."""
        if self._pipeline.onlooker is not None:
            raise StateError("the LRF is taking a scan for `ins-robot scan`: wait a moment")

    async def take(self) -> list[LaserScan]:
        """`lrf.revolutions` steady revolutions."""
        self.check_idle()
        taker = ScanTaker(self._config, lambda: self._pipeline.scanner)
        taker.is_always_on = False
        revolutions: list[LaserScan] = []

        def keep(revolution: LaserScan) -> None:
            if taker.is_steady(revolution) and taker.wants(revolution):
                revolutions.append(revolution)

        self._pipeline.onlooker = keep
        try:
            await taker.take(self._config.revolutions, revolutions.clear)
        finally:
            self._pipeline.onlooker = None
        return revolutions
