# SPDX-License-Identifier: MIT
"""A simulated robot in a world: one body, its three emulated devices, and the truth about it.

The same devices hang on memory wires for `simulate` or on pseudo-terminals and a socket for
`emulate`. Each device has a random stream of its own, so that a change in one leaves the
noise of the others as it was.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ins_robot.config import Config
from ins_robot.core.run_result import RunResult
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation import truth
from ins_robot.simulation.emulators.imu import (
    Hmc5883lEmulator,
    Mpu6050Emulator,
    Qmc5883lEmulator,
)
from ins_robot.simulation.emulators.lrf import LrfEmulator
from ins_robot.simulation.emulators.motor import MotorEmulator
from ins_robot.simulation.memory_wire import MemoryConnector
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.wire_device import RegisterDevice
from ins_robot.simulation.world import World

MOTOR_PERIOD_S = 0.02
LRF_PERIOD_S = 0.02


class SimulatedRobot:
    """Body and devices at `start` (world frame) in `world`, all drawn from `seed`."""

    def __init__(self, config: Config, world: World, start: Pose2, seed: int) -> None:
        streams = np.random.SeedSequence(seed).spawn(6)
        body_rng, optics_rng, lrf_rng, gyro_rng, compass_rng, _ = (
            np.random.default_rng(stream) for stream in streams
        )
        self.config = config
        self.world = world
        self.start = start
        self.body = RobotBody(world, start, config, body_rng)
        self.optics = WorldOptics(world, self.body, config.lrf, config.simulation, optics_rng)
        self.lrf = LrfEmulator(self.optics, lrf_rng, config.simulation)
        self.motors = MotorEmulator(self.body, config.wheels)
        compass: RegisterDevice
        if config.simulation.compass_chip == "hmc5883l":
            compass = Hmc5883lEmulator(self.body, config.simulation, compass_rng)
        else:
            compass = Qmc5883lEmulator(self.body, config.simulation, compass_rng)
        self.registers: list[RegisterDevice] = [
            Mpu6050Emulator(self.body, config.simulation, gyro_rng),
            compass,
        ]

    def memory_connector(self, clock: Callable[[], float]) -> MemoryConnector:
        """The devices at the config's addresses, inside this process."""
        devices = {self.config.lrf.port: self.lrf, self.config.wheels.port: self.motors}
        return MemoryConnector(devices, self.registers, clock)

    async def pump(self, connector: MemoryConnector) -> None:
        """Let the devices live on the loop's clock, for ever."""
        async with asyncio.TaskGroup() as group:
            group.create_task(connector.pump(self.config.wheels.port, MOTOR_PERIOD_S))
            group.create_task(connector.pump(self.config.lrf.port, LRF_PERIOD_S))

    def annotate(self, result: RunResult) -> RunResult:
        """Add what only the simulator knows: the true way, and how good the map is."""
        true_world = self.body.poses_at(result.stamps_s)
        true_map_from_base = truth.in_map_frame(true_world, self.start)
        return replace(
            result,
            true_map_from_base=true_map_from_base,
            truth_metrics=truth.metrics(
                self.config,
                self.body,
                self.optics,
                result.grid,
                result.map_from_base,
                true_map_from_base,
            ),
        )
