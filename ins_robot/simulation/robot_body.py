# SPDX-License-Identifier: MIT
"""The body of the simulated robot: motor duties in; wheel counts, contacts and true poses out.

Each wheel follows its duty with a lag and is counted by its encoder; on the ground it slips, by
a constant share and by a share that wanders. A body that would enter a wall is pushed back out
along the wall's normal, so that it slides. All poses are true and in the world frame.
"""

from __future__ import annotations

import math

import numpy as np

from ins_robot.config import Config
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.body_faults import BodyFault, FaultSchedule
from ins_robot.simulation.emulators.motor import BodyInputs
from ins_robot.simulation.magnetic_field import MagneticField
from ins_robot.simulation.noise import GaussianSource, OrnsteinUhlenbeck
from ins_robot.simulation.pose_history import PoseHistory
from ins_robot.simulation.world import World

STEP_S = 0.01
_ROUNDING_S = 1e-9
"""So little time left over from rounding is no step."""
_SLIP_TIME_S = 0.4
_CONTACT_ENDS_S = 0.5
"""A body free for this long touches anew; contacts closer in time are one collision."""
_BUMPER_GAP_M = 0.002
"""How far the body must be off the wall for the bumper to open again."""
_GRAZE_M = 1e-6
"""Nearer to a wall than the body's radius by less is touching, not entering it."""
_PUSHES = 5
_BATTERY_FULL_V = 12.4
_BATTERY_DROP_V_PER_H = 0.3
_STANDS_RADPS = 1e-6

Triple = tuple[float, float, float]

_BURST_GRIP: Triple = (0.2, 1.0, 0.4)
_NO_GRIP: Triple = (0.0, 0.0, 0.0)
_BATTERY_LOW_V = 9.0
_GYRO_STEP_DPS = 2.0
_COMPASS_TURN_RAD = math.radians(30.0)


class RobotBody:
    """One robot in one world.

    Parameters
    ----------
    world : World
    start : Pose2
        World frame; must fit (`World.start_pose` sees to that).
    config : Config
    rng : numpy.random.Generator
        Slip and metal objects.
    start_s : float
        Time at which the robot is set down.

    Attributes
    ----------
    collisions : int
        Contacts with a wall so far.
    path_length_m : float
        Way really gone.
    """

    temperature_c = 25.0

    def __init__(
        self,
        world: World,
        start: Pose2,
        config: Config,
        rng: np.random.Generator,
        start_s: float = 0.0,
    ) -> None:
        wheels, simulation = config.wheels, config.simulation
        self.world = world
        self.start = start
        self.radius_m = config.robot.radius_m
        self.collisions = 0
        self.path_length_m = 0.0
        self._kinematics = OmniKinematics(wheels)
        self._top_radps = wheels.free_speed_radps
        self._counts_per_rad = wheels.pulses_per_rev * wheels.quadrature / (2.0 * math.pi)
        self._lag_s = simulation.motor_lag_s
        self._slip_std = simulation.slip_std
        bias_rng, slip_rng, metal_rng = rng.spawn(3)
        bias = bias_rng.standard_normal(3) * simulation.slip_bias_std
        self._grip: list[float] = (1.0 + bias).tolist()
        source = GaussianSource(slip_rng)
        self._slips = [OrnsteinUhlenbeck(source, _SLIP_TIME_S) for _ in range(4)]
        self._metal = MagneticField(world, simulation.compass_disturbance, metal_rng)
        self._now_s = self._start_s = start_s
        self._x_m, self._y_m, self._heading_rad = start.x_m, start.y_m, start.heading_rad
        self._turns_rad = [0.0, 0.0, 0.0]
        self._speeds_radps = [0.0, 0.0, 0.0]
        self._twist_world: Triple = (0.0, 0.0, 0.0)
        self._is_touching = False
        self._touched_s = -math.inf
        self.faults = FaultSchedule()
        self._history = PoseHistory(start_s, (self._x_m, self._y_m, self._heading_rad))

    # Body of the motor emulator.

    def advance(self, to_s: float, duties: Triple) -> None:
        """Live until `to_s` with constant duties, each -1..1; 1 drives ccw."""
        while to_s - self._now_s > _ROUNDING_S:
            self._step(min(STEP_S, to_s - self._now_s), duties)

    def counts(self) -> tuple[int, int, int]:
        """Encoder totals in whole counts, positive where the wheel drove the body ccw."""
        a, b, c = self._turns_rad
        scale = self._counts_per_rad
        return math.floor(a * scale), math.floor(b * scale), math.floor(c * scale)

    def inputs(self) -> BodyInputs:
        """Bumper, cliff, emergency stop and battery now."""
        faults = self.faults.active(self._now_s)
        hours = (self._now_s - self._start_s) / 3600.0
        low = BodyFault.BATTERY_LOW in faults
        return BodyInputs(
            bumper=self._is_touching,
            cliff=BodyFault.CLIFF in faults,
            emergency_stop=BodyFault.EMERGENCY_STOP in faults,
            battery_v=_BATTERY_LOW_V
            if low
            else _BATTERY_FULL_V - _BATTERY_DROP_V_PER_H * hours,
        )

    # BodyMotion of the IMU emulator.

    def yaw_rate_radps(self, now_s: float) -> float:
        """True yaw rate, the latest known at `now_s`."""
        return self._twist_world[2]

    def gyro_shift_dps(self, now_s: float) -> float:
        """What a fault adds to the gyro's bias."""
        is_shifted = BodyFault.GYRO_BIAS_STEP in self.faults.active(now_s)
        return _GYRO_STEP_DPS if is_shifted else 0.0

    def field_gauss(self, now_s: float) -> Triple:
        """Magnetic field in the base frame, gauss."""
        ahead = max(0.0, now_s - self._now_s)
        heading = self._heading_rad + ahead * self._twist_world[2]
        if BodyFault.COMPASS_DISTURBED in self.faults.active(now_s):
            heading += _COMPASS_TURN_RAD
        c, s = math.cos(heading), math.sin(heading)
        fx, fy, fz = self._metal.at(self._x_m, self._y_m)
        return c * fx + s * fy, c * fy - s * fx, fz

    # Truth.

    @property
    def pose(self) -> Pose2:
        """True pose now, world_from_base."""
        return Pose2(self._x_m, self._y_m, wrap_rad(self._heading_rad))

    @property
    def now_s(self) -> float:
        """How far the body has lived."""
        return self._now_s

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) true poses, world_from_base, at the stamps (N,), in any order."""
        return self._history.at(stamps_s, self._twist_world)

    # Faults on purpose.

    def kidnap(self, to: Pose2) -> None:
        """Carry the robot elsewhere, wheels unaware; InputError where it does not fit."""
        if self.world.clearance.nearest_wall(to.x_m, to.y_m).distance_m < self.radius_m:
            raise InputError(
                f"kidnap to {to.x_m:.2f}, {to.y_m:.2f}: the body does not fit there"
            )
        self._x_m, self._y_m, self._heading_rad = to.x_m, to.y_m, to.heading_rad

    def carry(self, to: Pose2) -> None:
        """A person carries the body there, off the ground: no wheel turns, nothing touches."""
        self.path_length_m += math.hypot(to.x_m - self._x_m, to.y_m - self._y_m)
        self._x_m, self._y_m = to.x_m, to.y_m
        self._heading_rad += wrap_rad(to.heading_rad - self._heading_rad)

    def _step(self, dt_s: float, duties: Triple) -> None:
        self._now_s += dt_s
        if self._turn_wheels(dt_s, duties):
            self._move(dt_s)
        else:
            self._twist_world = (0.0, 0.0, 0.0)
            if self._is_touching:
                self._touched_s = self._now_s
        self._history.append(self._now_s, (self._x_m, self._y_m, self._heading_rad))

    def _turn_wheels(self, dt_s: float, duties: Triple) -> bool:
        """First-order lag of each wheel behind its duty; whether any wheel turns."""
        decay = math.exp(-dt_s / self._lag_s)
        turns = False
        for wheel in range(3):
            goal = duties[wheel] * self._top_radps
            begin = self._speeds_radps[wheel]
            end = goal + (begin - goal) * decay
            # Integral of the exponential approach over the step, exact.
            self._turns_rad[wheel] += goal * dt_s + (begin - end) * self._lag_s
            self._speeds_radps[wheel] = end
            turns = turns or abs(end) > _STANDS_RADPS or abs(begin) > _STANDS_RADPS
        return turns

    def _move(self, dt_s: float) -> None:
        vx, vy, yaw_rate = self._kinematics.twist(self._rolling_radps(dt_s))
        # Rollers give sideways too: a wandering share of the speed, across it.
        share = self._slip_std * self._slips[3].step(dt_s)
        vx, vy = vx - share * vy, vy + share * vx
        heading = self._heading_rad + 0.5 * yaw_rate * dt_s
        cos, sin = math.cos(heading), math.sin(heading)
        x = self._x_m + (cos * vx - sin * vy) * dt_s
        y = self._y_m + (sin * vx + cos * vy) * dt_s
        x, y = self._kept_out_of_walls(x, y)
        gone_x, gone_y = x - self._x_m, y - self._y_m
        self._x_m, self._y_m = x, y
        self._heading_rad += yaw_rate * dt_s
        self._twist_world = (gone_x / dt_s, gone_y / dt_s, yaw_rate)
        self.path_length_m += math.hypot(gone_x, gone_y)

    def _rolling_radps(self, dt_s: float) -> Triple:
        """What of each wheel's speed reaches the ground."""
        grip = [
            self._grip[wheel] + self._slip_std * self._slips[wheel].step(dt_s)
            for wheel in range(3)
        ]
        faults = self.faults.active(self._now_s)
        if BodyFault.SLIP_BURST in faults:
            grip = [g * burst for g, burst in zip(grip, _BURST_GRIP, strict=True)]
        if BodyFault.STUCK in faults:
            grip = [*_NO_GRIP]
        a, b, c = self._speeds_radps
        return a * grip[0], b * grip[1], c * grip[2]

    def _kept_out_of_walls(self, x: float, y: float) -> tuple[float, float]:
        """The place wanted, pushed out of the walls; where the body was when that fails."""
        clearance, radius = self.world.clearance, self.radius_m
        if clearance.at_least_m(x, y) > radius + _BUMPER_GAP_M:
            self._is_touching = False
            return x, y
        for _ in range(_PUSHES):
            wall = clearance.nearest_wall(x, y)
            if wall.distance_m >= radius - _GRAZE_M:
                self._is_touching &= wall.distance_m <= radius + _BUMPER_GAP_M
                return x, y
            self._touch()
            if wall.distance_m == 0.0:
                break
            push = radius / wall.distance_m
            x, y = wall.x_m + (x - wall.x_m) * push, wall.y_m + (y - wall.y_m) * push
        return self._x_m, self._y_m

    def _touch(self) -> None:
        self._is_touching = True
        if self._now_s - self._touched_s > _CONTACT_ENDS_S:
            self.collisions += 1
        self._touched_s = self._now_s
