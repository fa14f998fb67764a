# SPDX-License-Identifier: MIT
"""Gyro and compass as a stream of `ImuSample` at the configured rate.

Linux has no readiness event for I2C: a transfer blocks, on a hung bus for the adapter's
timeout. So every bus access runs on one thread this driver owns; pacing, waiting and retrying
happen on the event loop. A chip that lost power comes back asleep; it is set up again.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from ins_robot.config import ImuConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import ImuSample
from ins_robot.sensing.drivers.compass_chip import CompassChip, probe_compass
from ins_robot.sensing.drivers.gyro_chip import RESET_TIME_S, WAKE_TIME_S, GyroChip
from ins_robot.sensing.ports import I2cBus

T = TypeVar("T")

BUS_TIMEOUT_S = 2.0  # longer than an adapter's own; past it the thread is stuck
FAILURES_MAX = 25  # cycles in a row without an answer: half a second at 50 Hz
OPEN_ATTEMPTS = 3
# The chip's 67 ms and its oscillator's tolerance. Its "ready" stays on after reading, so that
# asking sooner would count one measurement twice.
COMPASS_PERIOD_S = 0.075
COMPASS_FAILURES_MAX = 10

_log = logging.getLogger(__name__)


@dataclass(slots=True, kw_only=True)
class ImuHealth:
    """What the driver has seen so far."""

    gyro: str = ""
    compass: str = ""
    samples: int = 0
    fields: int = 0
    bus_errors: int = 0
    compass_errors: int = 0
    compass_overflows: int = 0
    saturated: int = 0
    set_up_again: int = 0
    missed_ticks: int = 0


class ImuDriver:
    """MPU-6050 family and, where there is one, HMC5883L or QMC5883L."""

    def __init__(self, bus: I2cBus, config: ImuConfig, clock: Callable[[], float]) -> None:
        self._bus = bus
        self._config = config
        self._clock = clock
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="imu-i2c")
        self._gyro = GyroChip(bus, config.gyro_address, config.bus)
        self._compass: CompassChip | None = None
        self._compass_due_s = -math.inf
        self._compass_failures = 0
        self._is_busy = False
        self._is_closed = False
        yaw_rad = math.radians(config.compass_yaw_deg)
        self._mount = (math.cos(yaw_rad), math.sin(yaw_rad))
        self.health = ImuHealth()

    async def open(self) -> None:
        """Probe, reset and configure the chips, and read back what was written.

        Raises
        ------
        DeviceError
            The gyro is absent, is another chip, or does not keep its settings. A missing
            compass is a warning only.
        """
        gyro = self._gyro
        await self._insist(gyro.identify)
        if gyro.is_clone:
            _log.warning("gyro: a clone, %s, instead of an MPU-6050", gyro.identity.name)
        self.health.gyro = gyro.identity.name
        await self._insist(gyro.reset)
        await asyncio.sleep(RESET_TIME_S)
        await self._insist(gyro.reset_signal_path)
        await asyncio.sleep(RESET_TIME_S)
        await self._insist(gyro.configure)
        await asyncio.sleep(WAKE_TIME_S)
        difference = await self._insist(gyro.difference)
        if difference:
            raise DeviceError(f"{difference}; likely a failing chip or bus: check the wiring")
        if self._config.use_compass:
            await self._find_compass()

    async def samples(self) -> AsyncIterator[ImuSample]:
        """Readings at `rate_hz`, for ever; ticks that came too late are left out.

        Raises
        ------
        DeviceError
            The gyro has not answered for FAILURES_MAX ticks, or the bus hangs.
        """
        period_s = 1.0 / self._config.rate_hz
        due_s = self._clock()
        failures = 0
        while True:
            try:
                sample = await self._run(self._read)
                if sample is None:
                    await self._set_up_again()
                failures = 0
            except DeviceError:
                raise
            except OSError as error:
                failures += 1
                self.health.bus_errors += 1
                if failures >= FAILURES_MAX:
                    raise self._lost(error, failures) from None
                sample = None
                await self._look_after()
            if sample is not None and math.isfinite(sample.yaw_rate_radps):
                self.health.samples += 1
                yield sample
            due_s += period_s
            late_s = self._clock() - due_s
            if late_s >= period_s:
                missed = int(late_s / period_s)
                self.health.missed_ticks += missed
                due_s += missed * period_s
            await asyncio.sleep(max(0.0, due_s - self._clock()))

    def close(self) -> None:
        """Let go of the bus and the thread; may be called again."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._is_busy:
            self._executor.submit(self._bus.close)  # behind the transfer under way
        else:
            self._bus.close()
        self._executor.shutdown(wait=False)

    def _read(self) -> ImuSample | None:
        """In the thread: one sample; None when the chip has to be set up again."""
        config = self._config
        stamp_s = self._clock()
        reading = self._gyro.read()
        if reading is None:
            return None
        rate_radps = config.gyro_sign * config.gyro_scale * reading.yaw_rate_radps
        if reading.is_saturated:
            self.health.saturated += 1
            rate_radps = math.nan
        return ImuSample(
            stamp_s=stamp_s,
            yaw_rate_radps=rate_radps,
            field_gauss=self._read_field(stamp_s),
            temperature_c=reading.temperature_c,
        )

    def _read_field(self, now_s: float) -> tuple[float, float, float] | None:
        """In the thread: the field in the base frame, when a new one is due and there."""
        if self._compass is None or now_s < self._compass_due_s:
            return None
        self._compass_due_s = now_s + COMPASS_PERIOD_S
        try:
            field = self._compass.read()
        except OSError as error:
            self._on_compass_failure(error)
            return None
        self.health.compass_overflows = self._compass.overflows
        self._compass_failures = 0
        if field is None:
            return None
        self.health.fields += 1
        x, y, z = field
        c, s = self._mount
        return c * x - s * y, s * x + c * y, z

    def _on_compass_failure(self, error: OSError) -> None:
        self.health.compass_errors += 1
        self._compass_failures += 1
        if self._compass_failures >= COMPASS_FAILURES_MAX and self._compass is not None:
            _log.warning("compass: %s lost (%s); going on without", self._compass.name, error)
            self._compass = None
            self.health.compass = ""

    async def _find_compass(self) -> None:
        self._compass = await self._insist(lambda: probe_compass(self._bus))
        if self._compass is None:
            _log.warning(
                "compass: neither an HMC5883L (0x1e) nor a QMC5883L (0x0d) on %s; going on "
                "without (imu.use_compass = false silences this)",
                self._config.bus,
            )
        else:
            self.health.compass = self._compass.name

    async def _look_after(self) -> None:
        """Check, after a failed transfer, whether the chip lost its settings meanwhile."""
        try:
            if await self._run(self._gyro.difference):
                await self._set_up_again()
        except DeviceError:
            raise
        except OSError:
            self.health.bus_errors += 1  # still gone; the next tick tries again

    async def _set_up_again(self) -> None:
        """The chip came back as from power-on, or sleeps: wake and configure both chips."""
        self.health.set_up_again += 1
        _log.warning("gyro: lost its settings (power dip?); set up again")
        await self._run(self._gyro.configure)
        await asyncio.sleep(WAKE_TIME_S)
        if self._compass is not None:
            try:
                await self._run(self._compass.configure)
            except DeviceError:
                raise
            except OSError as error:
                self._on_compass_failure(error)

    def _lost(self, error: OSError, failures: int) -> DeviceError:
        return DeviceError(
            f"gyro at 0x{self._config.gyro_address:02x} on {self._config.bus}: no answer "
            f"{failures} times in a row (limit {FAILURES_MAX}): {error}; likely a loose "
            "wire or no power; check it, then restart"
        )

    async def _insist(self, call: Callable[[], T]) -> T:
        """Run in the thread, with a second and third try: sporadic errors are usual on a Pi."""
        attempt = 1
        while True:
            try:
                return await self._run(call)
            except DeviceError:
                raise
            except OSError as error:
                self.health.bus_errors += 1
                if attempt == OPEN_ATTEMPTS:
                    raise self._lost(error, attempt) from None
            attempt += 1
            await asyncio.sleep(RESET_TIME_S)

    async def _run(self, call: Callable[[], T]) -> T:
        """One piece of bus work on the driver's thread."""
        loop = asyncio.get_running_loop()
        self._is_busy = True
        try:
            async with asyncio.timeout(BUS_TIMEOUT_S) as limit:
                outcome = await loop.run_in_executor(self._executor, call)
        except TimeoutError:
            if not limit.expired():
                self._is_busy = False
                raise  # the adapter's own timeout: an OSError like others
            raise DeviceError(
                f"I2C bus {self._config.bus}: a transfer hangs for more than "
                f"{BUS_TIMEOUT_S:g} s; likely a device holds the clock line: cut its power"
            ) from None
        except OSError:
            self._is_busy = False
            raise
        self._is_busy = False
        return outcome
