# SPDX-License-Identifier: MIT
"""The device tasks: each opens its device, reads it for ever, and hands every datum on.

sense (here) -> estimate and navigate (`mission`) -> control (`pilot`) -> wheels (here again).
The supervisor runs a task again when its device was lost; what a run does about it is the
mission's affair.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable

from ins_robot.config import Config
from ins_robot.daemon.health import Health
from ins_robot.daemon.run_under_way import RunUnderWay
from ins_robot.errors import DeviceError
from ins_robot.messages import LaserScan, WheelSample
from ins_robot.sensing.drivers.imu import ImuDriver
from ins_robot.sensing.drivers.lrf import LrfDriver
from ins_robot.sensing.drivers.motor import MotorDriver
from ins_robot.sensing.ports import Connector

log = logging.getLogger(__name__)

STANDING = (0.0, 0.0, 0.0)


class Pipeline:
    """The devices that `base.kind` has, and where their data go."""

    def __init__(
        self, config: Config, connector: Connector, clock: Callable[[], float], health: Health
    ) -> None:
        self._config = config
        self._connector = connector
        self._clock = clock
        self._health = health
        self._lrf: LrfDriver | None = None
        self._motor: MotorDriver | None = None
        self.mission: RunUnderWay | None = None
        self.onlooker: Callable[[LaserScan], None] | None = None  # sees revolutions too
        self.last_wheels: WheelSample | None = None
        self.on_fault: Callable[[str], None] = lambda fault: None
        self.on_tick: Callable[[float], None] = lambda now_s: None
        self._imu: ImuDriver | None = None
        self.complete = asyncio.Event()  # set while no device is missing

    @property
    def scanner(self) -> LrfDriver:
        """The LRF; DeviceError while it is not there."""
        if self._lrf is None:
            raise DeviceError(f"lrf: not connected at {self._config.lrf.port}")
        return self._lrf

    @property
    def motors(self) -> MotorDriver:
        """The motor microcontroller; DeviceError while it is not there."""
        if self._motor is None:
            raise DeviceError(f"motors: not connected at {self._config.wheels.port}")
        return self._motor

    @property
    def missing(self) -> list[str]:
        """The devices that are not there."""
        there: dict[str, object] = {"lrf": self._lrf}
        if self._config.base.kind != "manual":
            there |= {"motors": self._motor, "imu": self._imu}
        return [name for name, device in there.items() if device is None]

    async def serve_lrf(self) -> None:
        """Read the laser range finder until it is lost."""
        config = self._config.lrf
        stream = await self._connector.open_stream(config.port, config.baud)
        lrf = LrfDriver(stream, config, self._clock)
        try:
            await lrf.open()
            self._lrf = lrf
            self._count_devices()
            async for revolution in lrf.revolutions():
                self._health.beat("lrf", self._clock())
                if self.mission is not None:
                    self.mission.on_revolution(revolution)
                if self.onlooker is not None:
                    self.onlooker(revolution)
        finally:
            self._lrf = None
            self._count_devices()
            lrf.close()

    async def serve_imu(self) -> None:
        """Read gyro and compass until they are lost."""
        imu = ImuDriver(
            self._connector.open_i2c(self._config.imu.bus), self._config.imu, self._clock
        )
        try:
            await imu.open()
            self._imu = imu
            self._count_devices()
            async for sample in imu.samples():
                self._health.beat("imu", sample.stamp_s)
                if self.mission is not None:
                    self.mission.on_imu(sample)
        finally:
            self._imu = None
            self._count_devices()
            imu.close()

    async def serve_motors(self) -> None:
        """Answer every telemetry frame with wheel speeds until the microcontroller is lost."""
        config = self._config.wheels
        stream = await self._connector.open_stream(config.port, config.baud)
        motor = MotorDriver(stream, config, self._clock)
        try:
            await motor.open()
            self._motor = motor
            self._count_devices()
            async for sample in motor.samples():
                self._health.beat("wheels", sample.stamp_s)
                begun_s = time.perf_counter()
                self._on_wheels(sample, motor)
                self._health.took("control", time.perf_counter() - begun_s)
        finally:
            self._motor = None
            self._count_devices()
            motor.close()

    def _count_devices(self) -> None:
        if self.missing:
            self.complete.clear()
        else:
            self.complete.set()

    def _on_wheels(self, sample: WheelSample, motor: MotorDriver) -> None:
        before, self.last_wheels = self.last_wheels, sample
        if sample.fault and (before is None or before.fault != sample.fault):
            self.on_fault(sample.fault)
        speeds = STANDING
        if self.mission is not None:
            speeds = self.mission.on_wheels(sample)
        motor.set_wheel_speeds(speeds)
        self.on_tick(sample.stamp_s)
