# SPDX-License-Identifier: MIT
"""So many steady revolutions of the LRF, its motor on for no longer than that.

Used by runs and by `ins-robot scan`. Revolutions come in by `wants`; whose they are and where
they go is the caller's affair.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from typing import Protocol

from ins_robot.config import LrfConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import LaserScan
from ins_robot.sensing.scan_filter import is_at_speed

log = logging.getLogger(__name__)

RECONNECT_S = 3.0  # the supervisor has opened the LRF again by then, if it is there


class ScannerPower(Protocol):
    """The part of the LRF driver that is commanded here."""

    @property
    def set_rpm(self) -> float:
        """The speed it is told to hold."""
        ...

    async def motor_on(self) -> None:
        """Start turning."""
        ...

    async def motor_off(self) -> None:
        """Stop turning."""
        ...


class ScanTaker:
    """Takes one scan at a time; knows for how long the motor was on."""

    def __init__(self, config: LrfConfig, scanner: Callable[[], ScannerPower]) -> None:
        self.on_s = 0.0
        self.is_always_on = config.power == "continuous"
        self._config = config
        self._scanner = scanner
        self._clock = asyncio.get_running_loop().time
        self._wanted = 0  # revolutions still missing from the scan being taken
        self._is_whole = asyncio.Event()
        self._begun_s = 0.0
        self._on_since_s: float | None = None

    @property
    def set_rpm(self) -> float:
        """The speed the LRF is told to hold."""
        return self._scanner().set_rpm

    async def take(self, revolutions: int, begin: Callable[[], None]) -> None:
        """Wait for so many steady revolutions; `begin` is called when they begin to count.

        A line lost for a moment gets a second chance: then `begin` is called again.
        """
        try:
            await self._take_once(revolutions, begin)
        except DeviceError as error:
            log.warning("%s; once more", error)
            await asyncio.sleep(RECONNECT_S)
            await self._take_once(revolutions, begin)

    def is_steady(self, revolution: LaserScan) -> bool:
        """Whether it ran at the set speed."""
        return is_at_speed(revolution, self._config, self.set_rpm)

    def wants(self, revolution: LaserScan) -> bool:
        """Whether this steady revolution belongs to the scan being taken; it then counts."""
        if not self._wanted or revolution.stamp_s < self._begun_s:
            return False
        self._wanted -= 1
        if not self._wanted:
            self._is_whole.set()
        return True

    async def switch_on(self) -> None:
        """Start the motor."""
        self._on_since_s = self._clock()
        await self._scanner().motor_on()

    async def switch_off(self) -> None:
        """Stop the motor if it is on."""
        if self._on_since_s is None:
            return
        self.on_s += self._clock() - self._on_since_s
        self._on_since_s = None
        with contextlib.suppress(DeviceError):  # a lost LRF turns nothing
            await self._scanner().motor_off()

    async def _take_once(self, revolutions: int, begin: Callable[[], None]) -> None:
        config = self._config
        timeout_s = 2.0 * config.spin_up_timeout_s + 4.0 * revolutions * 60.0 / config.rpm
        try:
            if self._on_since_s is None:
                await self.switch_on()
            begin()
            self._begun_s = self._clock()
            self._is_whole.clear()
            self._wanted = revolutions
            async with asyncio.timeout(timeout_s):
                await self._is_whole.wait()
        except TimeoutError:
            raise DeviceError(
                f"lrf: no {revolutions} steady revolutions at {self.set_rpm:.0f} rpm within "
                f"{timeout_s:.0f} s: motor blocked, belt off, or supply too weak"
            ) from None
        finally:
            self._wanted = 0
            if not self.is_always_on:
                await self.switch_off()
