# SPDX-License-Identifier: MIT
"""The simulated sensors recorded as the real ones were: standing in homes, in a box, driving.

Everything goes through the emulators and optics that `ins-robot simulate` uses; the LRF in the
box is read from its bytes by the same code as the real capture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ins_robot.config import Config, LrfConfig, SimulationConfig
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.emulators import gyro_chip
from ins_robot.simulation.emulators.lrf import LrfEmulator
from ins_robot.simulation.optics import WorldOptics
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.world import World
from sensor_study.recordings import Capture, decode_capture
from sensor_study.standstill import Standstill

TURN_RAD = np.radians(np.arange(360.0))
TURNS = 20
CAPTURE_RPM, CAPTURE_S, SPIN_UP_S = 297.0, 24.0, 4.0
BOX_M = (0.85, 0.75)  # the box of the capture: walls 0.3 to 0.55 m away
GYRO_PERIOD_S = 0.0088
SILENT = SimulationConfig(
    range_std_floor_m=0.0,
    range_std_per_m3=0.0,
    drop_out=0.0,
    drop_out_grazing=0.0,
    mixed_pixels=0.0,
)


@dataclass(frozen=True)
class StandingTurns:
    """T turns from one place, and how far the walls really are, (360,)."""

    standstill: Standstill
    true_m: FloatArray


def stand_in_homes(
    worlds: list[Path],
    simulation: SimulationConfig,
    is_open: np.ndarray,
    places: int,
    seed: int,
) -> list[StandingTurns]:
    """Turns from `places` random places of each world; beams that are not open see nothing."""
    rng = np.random.default_rng(seed)
    found = []
    for path in worlds:
        world = World.load(path)
        radius_m = Config().robot.radius_m
        reachable = world.reachable(world.start_pose(None, radius_m), radius_m)
        spots = world.metres(np.argwhere(reachable) + 0.5)
        for x, y in spots[rng.integers(len(spots), size=places)].tolist():
            pose = Pose2(x, y, rng.uniform(-math.pi, math.pi))
            body = RobotBody(world, pose, Config(), rng)
            true = WorldOptics(world, body, LrfConfig(), SILENT, rng)
            optics = WorldOptics(world, body, LrfConfig(), simulation, rng)
            true_m = true.measure(np.zeros(360), TURN_RAD).range_m
            ranges_m = optics.measure(np.zeros(360 * TURNS), np.tile(TURN_RAD, TURNS)).range_m
            ranges_m = np.where(is_open, ranges_m.reshape(TURNS, 360), np.nan)
            found.append(StandingTurns(Standstill(path.stem, ranges_m, is_open), true_m))
    return found


def spin_in_box(simulation: SimulationConfig, seed: int) -> Capture:
    """What the emulated LRF sends from inside a box, decoded."""
    rng = np.random.default_rng(seed)
    cells = [round(side / 0.01) + 2 for side in BOX_M[::-1]]
    walls = np.ones(cells, dtype=bool)
    walls[1:-1, 1:-1] = False
    world = World(walls, 0.01, (-0.01, -0.01))
    heading = rng.uniform(-math.pi, math.pi)
    body = RobotBody(world, Pose2(0.45, 0.36, heading), small_robot(), rng)
    optics = WorldOptics(world, body, LrfConfig(), simulation, rng)
    emulator = LrfEmulator(optics, rng, rpm_ripple=simulation.rpm_ripple)
    emulator.receive(f"SetRPM {CAPTURE_RPM:g}\n".encode(), 0.0)
    chunks = [
        emulator.advance(0.1 * step) for step in range(1, round((SPIN_UP_S + CAPTURE_S) / 0.1))
    ]
    return decode_capture(b"".join(chunks[round(SPIN_UP_S / 0.1) :]))


def small_robot() -> Config:
    config = Config()
    return replace(config, robot=replace(config.robot, radius_m=0.05))


class _Standing:
    temperature_c = 25.0

    def yaw_rate_radps(self, now_s: float) -> float:
        return 0.0

    def gyro_shift_dps(self, now_s: float) -> float:
        return 0.0

    def field_gauss(self, now_s: float) -> tuple[float, float, float]:
        return (0.2, 0.0, 0.0)


def listen_to_gyro(
    simulation: SimulationConfig, duration_s: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Stamps and rates (deg/s, counter-clockwise) of the emulated gyro on a body at rest."""
    chip = gyro_chip.Mpu6050Emulator(_Standing(), simulation, np.random.default_rng(seed))
    for register, value in (
        (gyro_chip.PWR_MGMT_1, 1),
        (gyro_chip.CONFIG, 3),
        (gyro_chip.SMPLRT_DIV, 7),
        (gyro_chip.GYRO_CONFIG, 0),
    ):
        chip.write(register, bytes([value]), 0.0)
    stamps_s = np.arange(0.1, duration_s, GYRO_PERIOD_S)
    raw = [chip.read(0x47, 2, float(s)) for s in stamps_s]
    counts = np.array([int.from_bytes(word, "big", signed=True) for word in raw])
    return stamps_s, counts / gyro_chip.GYRO_LSB_PER_DPS[0]


def drive_around(
    simulation: SimulationConfig, way_m: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """(N, 3) true poses and (N, 3) poses by wheels alone of a body that drives in arcs."""
    rng = np.random.default_rng(seed)
    walls = np.ones((402, 402), dtype=bool)
    walls[1:-1, 1:-1] = False
    config = replace(Config(), simulation=simulation)
    body = RobotBody(World(walls, 0.1), Pose2(20.0, 20.0), config, rng)
    kinematics = OmniKinematics(config.wheels)
    per_rad = config.wheels.pulses_per_rev * config.wheels.quadrature / (2.0 * math.pi)
    counts, truth = [body.counts()], [body.pose.as_array()]
    while body.path_length_m < way_m:
        yaw_rate = rng.uniform(-0.5, 0.5)
        speeds = kinematics.wheel_speeds(0.2, 0.0, yaw_rate)
        a, b, c = (w / config.wheels.free_speed_radps for w in speeds)
        for _ in range(30):
            body.advance(body.now_s + 0.1, (a, b, c))
            counts.append(body.counts())
            truth.append(body.pose.as_array())
    poses = [Pose2.from_array(truth[0])]
    for step in np.diff(np.array(counts), axis=0) / per_rad:
        vx, vy, turn = kinematics.twist((float(step[0]), float(step[1]), float(step[2])))
        half = Pose2(0.0, 0.0, 0.5 * turn)
        poses.append(poses[-1] @ half @ Pose2(vx, vy, 0.0) @ half)
    return np.array(truth), np.array([pose.as_array() for pose in poses])
