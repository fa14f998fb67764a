# SPDX-License-Identifier: MIT
"""A simulated robot in a world: one body, its three emulated devices, and the truth about it.

The same devices hang on memory wires for `simulate` or on pseudo-terminals and a socket for
`emulate`. Each has a random stream of its own, so that a change in one leaves the noise of the
others as it was.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ins_robot.config import Config
from ins_robot.core.run_result import RunResult
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation import truth
from ins_robot.simulation.emulators.imu import build_imu_devices
from ins_robot.simulation.emulators.lrf import LrfEmulator
from ins_robot.simulation.emulators.motor import MotorEmulator
from ins_robot.simulation.memory_wire import MemoryConnector
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.person import Person
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.wire_device import WireDevice
from ins_robot.simulation.world import World

MOTOR_PERIOD_S = 0.02
LRF_PERIOD_S = 0.02
STILL = (0.0, 0.0, 0.0)


class SimulatedRobot:
    """Body and devices at `start` (world frame) in `world`, all drawn from `seed`.

    `start_s` is the time of the loop they will live on, now.
    """

    def __init__(
        self, config: Config, world: World, start: Pose2, seed: int, start_s: float = 0.0
    ) -> None:
        rngs = np.random.default_rng(seed).spawn(5)
        body_rng, optics_rng, lrf_rng, imu_rng, person_rng = rngs
        self._config = config
        self.body = RobotBody(world, start, config, body_rng, start_s)
        self.optics = WorldOptics(world, self.body, config.lrf, config.simulation, optics_rng)
        self.lrf = LrfEmulator(
            self.optics,
            lrf_rng,
            yaw_rad=math.radians(config.lrf.yaw_deg),
            is_clockwise=config.lrf.is_clockwise,
            rpm_ripple=config.simulation.rpm_ripple,
        )
        self.motors = MotorEmulator(self.body, config.wheels)
        self.person = Person(self.body, config.simulation, person_rng)
        self.registers = build_imu_devices(self.body, config.imu, config.simulation, imu_rng)

    def memory_connector(self, clock: Callable[[], float]) -> MemoryConnector:
        """The devices at the config's addresses, inside this process."""
        devices: dict[str, WireDevice] = {
            self._config.lrf.port: self.lrf,
            self._config.wheels.port: self.motors,
        }
        return MemoryConnector(devices, self.registers, clock)

    async def pump(self, connector: MemoryConnector) -> None:
        """Let the devices live on the loop's clock, for ever."""
        async with asyncio.TaskGroup() as group:
            if self._config.base.kind == "manual":
                group.create_task(self.be_carried())
            else:
                group.create_task(connector.pump(self._config.wheels.port, MOTOR_PERIOD_S))
            group.create_task(connector.pump(self._config.lrf.port, LRF_PERIOD_S))

    async def be_carried(self) -> None:
        """Live without motors, for ever: only the person moves the body."""
        loop = asyncio.get_running_loop()
        while True:
            self.body.advance(loop.time(), STILL)
            await asyncio.sleep(MOTOR_PERIOD_S)

    def annotate(self, result: RunResult) -> RunResult:
        """Add what only the simulator knows: the true way, faults, how good the map is."""
        body = self.body
        true = truth.in_map_frame(body.poses_at(result.stamps_s), body.start)
        found = truth.metrics(
            self._config, body, self.optics, result.grid, result.map_from_base, true
        )
        faults = self.body.faults.as_json()
        notes = {**result.notes, "faults": faults} if faults else result.notes
        return replace(result, true_map_from_base=true, truth_metrics=found, notes=notes)
