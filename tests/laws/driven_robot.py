# SPDX-License-Identifier: MIT
"""A robot that drives a given velocity profile exactly, as its encoders and gyro report it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ins_robot.config import ImuConfig, KalmanConfig, WheelsConfig
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.core.odometry import Odometry
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import ImuSample, WheelSample

TICK_S = 0.02
SUBSTEPS = 5
Velocity = tuple[float, float, float]
Profile = Callable[[float], Velocity]


def standing(_t_s: float) -> Velocity:
    return 0.0, 0.0, 0.0


@dataclass(kw_only=True)
class DrivenRobot:
    """`drive` advances the truth and feeds the odometry; noise only where asked for."""

    wheels: WheelsConfig = field(default_factory=WheelsConfig)
    kalman: KalmanConfig = field(default_factory=KalmanConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    bias_radps: float = 0.02
    gyro_std_radps: float = 0.0
    wheel_std_mps: float = 0.0  # of vx and vy, each tick
    wheel_yaw_std_radps: float = 0.0
    way_std: float = 0.0  # position error per sqrt(m): the floor's, in truth, unseen
    seed: int = 0
    imu_phase_s: float = 0.006

    def __post_init__(self) -> None:
        self.odometry = Odometry(self.kalman, self.imu, self.wheels)
        self.rng = np.random.default_rng(self.seed)
        self.now_s = 0.0
        self.truth = (0.0, 0.0, 0.0)
        self._angles = [0.0, 0.0, 0.0]
        self._kinematics = OmniKinematics(self.wheels)
        self._counts_per_rad = (
            self.wheels.pulses_per_rev * self.wheels.quadrature / (2.0 * math.pi)
        )
        self.has_gyro = True
        self.wheel_slip: Velocity = (0.0, 0.0, 0.0)  # seen by the wheels, not done by the body
        self.field: Callable[[Pose2], tuple[float, float, float]] | None = None
        self.ticks = 0

    @property
    def pose(self) -> Pose2:
        return Pose2(*self.truth)

    def counts(self) -> tuple[int, int, int]:
        a, b, c = (round(angle * self._counts_per_rad) for angle in self._angles)
        return a, b, c

    def drive(self, profile: Profile, duration_s: float) -> None:
        begin_s, h = self.now_s, TICK_S / SUBSTEPS
        for _ in range(round(duration_s / TICK_S)):
            tick_s, means = self.now_s, [0.0, 0.0, 0.0]
            for j in range(SUBSTEPS):
                t = tick_s + j * h
                if self.has_gyro and j == round(self.imu_phase_s / h):
                    self._read_gyro(t, profile(t - begin_s)[2])
                velocity = profile(t + 0.5 * h - begin_s)
                self._move(velocity, h)
                means = [m + v / SUBSTEPS for m, v in zip(means, velocity, strict=True)]
            self._turn_wheels(means)
            self.now_s = tick_s + TICK_S
            self.ticks += 1
            self.odometry.on_wheels(
                WheelSample(stamp_s=self.now_s, device_s=self.now_s, counts=self.counts())
            )

    def _read_gyro(self, t: float, omega: float) -> None:
        rate = omega + self.bias_radps + self.gyro_std_radps * float(self.rng.standard_normal())
        seen = self.field(self.pose) if self.field and self.ticks % 3 == 0 else None
        self.odometry.on_imu(ImuSample(stamp_s=t, yaw_rate_radps=rate, field_gauss=seen))

    def _move(self, velocity: Velocity, h: float) -> None:
        vx, vy, omega = velocity
        x, y, heading = self.truth
        c, s = math.cos(heading + 0.5 * omega * h), math.sin(heading + 0.5 * omega * h)
        off = [0.0, 0.0]
        if self.way_std:
            way_m = math.hypot(vx, vy) * h
            off = (self.way_std * math.sqrt(way_m) * self.rng.standard_normal(2)).tolist()
        self.truth = (
            x + h * (c * vx - s * vy) + off[0],
            y + h * (s * vx + c * vy) + off[1],
            heading + h * omega,
        )

    def _turn_wheels(self, means: list[float]) -> None:
        vx, vy, omega = (m + s for m, s in zip(means, self.wheel_slip, strict=True))
        if any(means):
            a, b, c = self.rng.standard_normal(3).tolist()
            vx, vy = vx + self.wheel_std_mps * a, vy + self.wheel_std_mps * b
            omega += self.wheel_yaw_std_radps * c
        speeds = self._kinematics.wheel_speeds(vx, vy, omega)
        self._angles = [a + w * TICK_S for a, w in zip(self._angles, speeds, strict=True)]
