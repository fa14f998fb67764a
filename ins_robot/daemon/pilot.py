# SPDX-License-Identifier: MIT
"""From a pose to wheel speeds, once per telemetry frame (50 Hz).

path follower -> velocity limits -> collision guard (the last word) -> wheel kinematics.
Ticking on telemetry means the freshest pose and no second timer; when telemetry ends, so do
the set points, and the microcontroller's dead-man stops the wheels by itself.
"""

from __future__ import annotations

import asyncio
import contextlib

from scipy.spatial import cKDTree

from ins_robot.config import Config
from ins_robot.control.collision_guard import CollisionGuard, NoGuard
from ins_robot.control.kinematics import OmniKinematics
from ins_robot.control.limits import VelocityLimits
from ins_robot.control.path_follower import Following, PathFollower
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath, VelocityCommand

Wheels = tuple[float, float, float]
LOOK_AHEAD_S = 20.0
RAMP_MAX_S = 3.0  # from any speed to standing
STANDING: Wheels = (0.0, 0.0, 0.0)


class Pilot:
    """Drives along one path at a time; can be held, and stopped for good until cleared."""

    def __init__(self, config: Config) -> None:
        control = config.control
        self._control = control
        self._kinematics = OmniKinematics(config.wheels)
        self._limits = VelocityLimits(control)
        self._guard: CollisionGuard | NoGuard = (
            CollisionGuard(control, config.robot.radius_m) if control.guard else NoGuard()
        )
        self._follower: PathFollower | None = None
        self._arrival: asyncio.Future[Following] | None = None
        self.velocity = VelocityCommand()
        self.is_held = False
        self.is_stopped = False
        self.guard_ticks = 0
        self.standing = asyncio.Event()  # set while the last command was to stand
        self.standing.set()

    def observe(self, walls: cKDTree) -> None:
        """What the guard shall know of the obstacles, from now on: points (N, 2) on them."""
        self._guard.observe(walls)

    def follow(self, path: PlannedPath) -> asyncio.Future[Following]:
        """Drive along `path` (map frame); the future tells how it ended."""
        self.halt()
        self._follower = PathFollower(path, self._control)
        self._arrival = asyncio.get_running_loop().create_future()
        return self._arrival

    def clearance_m(self, pose: Pose2) -> float:
        """From the body at `pose` to the nearest known obstacle."""
        return self._guard.clearance_m(pose)

    def is_blocked(self, pose: Pose2) -> bool:
        """True when the guard would stop the robot, now at `pose`, on the path still ahead."""
        if self._follower is None:
            return False
        points = self._follower.points_ahead(LOOK_AHEAD_S)
        return self._guard.blocks((pose.x_m, pose.y_m), points)

    def halt(self) -> None:
        """Forget the path; the next ticks ramp down to standing."""
        if self._arrival is not None and not self._arrival.done():
            self._arrival.cancel()
        self._follower = self._arrival = None

    async def rest(self) -> None:
        """Wait for the end of the ramp, for a while: without telemetry there is none."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(RAMP_MAX_S):
                await self.standing.wait()

    def stop_now(self) -> None:
        """Command zero without a ramp until `release`."""
        self.is_stopped = True
        self._limits.reset()
        self.velocity = VelocityCommand()
        self.standing.set()

    def start_from_rest(self) -> None:
        """Something else has stopped the wheels; the next commands ramp up from zero."""
        self._limits.reset()

    def release(self) -> None:
        """End `stop_now`."""
        self.is_stopped = False

    def tick(self, pose: Pose2, dt_s: float) -> Wheels:
        """Wheel speeds in rad/s for the robot at `pose` (map frame)."""
        if self.is_stopped:
            return STANDING
        wanted = VelocityCommand()
        if self._follower is not None and not self.is_held:
            wanted = self._follower.step(pose, dt_s)
            self._tell_arrival()
        limited, _ = self._limits.apply(wanted, dt_s)
        self.velocity, was_guarded = self._guard.apply(pose, limited)
        self.guard_ticks += was_guarded
        self._limits.follow(self.velocity)
        v = self.velocity
        if v.vx_mps == 0.0 and v.vy_mps == 0.0 and v.yaw_rate_radps == 0.0:
            self.standing.set()
            return STANDING
        self.standing.clear()
        wheels = self._kinematics.wheel_speeds(v.vx_mps, v.vy_mps, v.yaw_rate_radps)
        return self._kinematics.limited(wheels)[0]

    def _tell_arrival(self) -> None:
        assert self._follower is not None
        if self._follower.verdict is Following.ON_THE_WAY:
            return
        if self._arrival is not None and not self._arrival.done():
            self._arrival.set_result(self._follower.verdict)
        self._follower = None
