# SPDX-License-Identifier: MIT
"""A person who carries the simulated LRF: walks a way, and puts it down about where asked.

For `base.kind = "manual"`. The person knows the map's frame (it begins where the body does) and
sees the building, so walks around obstacles, but places the LRF by eye: decimetres and degrees
off, from the seed. Never into a wall.
"""

from __future__ import annotations

import asyncio
import math
from itertools import pairwise

import numpy as np

from ins_robot.config import SimulationConfig
from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.robot_body import RobotBody

STEP_S = 0.1
STEP_BACK_S = 2.0  # out of the LRF's sight
SAMPLE_M = 0.02
HESITATIONS = 10  # places that do not fit before the person stays where the way ends


class Person:
    """Walks; all of it on the loop's clock."""

    def __init__(
        self, body: RobotBody, config: SimulationConfig, rng: np.random.Generator
    ) -> None:
        self._body = body
        self._config = config
        self._rng = rng

    async def walk(self, points_m: FloatArray, place: Pose2) -> None:
        """Carry the LRF along points (N, 2), put it down about at `place`; map frame."""
        body, start = self._body, self._body.start
        end = self._put_down_at(start @ place)
        here = body.pose
        way = [(here.x_m, here.y_m), *start.apply(points_m)[1:-1], (end.x_m, end.y_m)]
        turn_rad = wrap_rad(end.heading_rad - here.heading_rad)
        length_m = sum(math.dist(a, b) for a, b in pairwise(way))
        gone_m = 0.0
        for a, b in pairwise(way):
            leg_m = math.dist(a, b)
            steps = max(1, math.ceil(leg_m / (self._config.person_mps * STEP_S)))
            for share in np.linspace(0.0, 1.0, steps + 1)[1:].tolist():
                done = (gone_m + share * leg_m) / length_m if length_m else 1.0
                x_m, y_m = (float(p + share * (q - p)) for p, q in zip(a, b, strict=True))
                body.carry(Pose2(x_m, y_m, wrap_rad(here.heading_rad + done * turn_rad)))
                await asyncio.sleep(STEP_S)
            gone_m += leg_m
        await asyncio.sleep(STEP_BACK_S)

    def go(self, bearing_rad: float, distance_m: float, turn_rad: float) -> Pose2:
        """Put the LRF down as `ins-robot next` says, seen from where it is; the place.

        Raises
        ------
        InputError
            Where it does not fit.
        """
        here = self._body.pose
        there = Pose2(
            distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad), turn_rad
        )
        wanted = here @ there
        end = self._put_down_at(wanted)
        if not self._fits(end):
            raise InputError(
                f"carry: the body of {self._body.radius_m:g} m does not fit there; it stays"
            )
        self._body.carry(end)
        return end

    def _put_down_at(self, wanted: Pose2) -> Pose2:
        """A place about there (world frame) where the LRF fits and is not behind a wall."""
        config = self._config
        std = np.array(
            [config.person_std_m, config.person_std_m, math.radians(config.person_std_deg)]
        )
        for _ in range(HESITATIONS):
            x, y, heading = wanted.as_array() + std * self._rng.standard_normal(3)
            place = Pose2(float(x), float(y), wrap_rad(float(heading)))
            if self._fits(place) and self._sees(wanted, place):
                return place
        return wanted

    def _fits(self, place: Pose2) -> bool:
        clearance = self._body.world.clearance
        return clearance.nearest_wall(place.x_m, place.y_m).distance_m >= self._body.radius_m

    def _sees(self, wanted: Pose2, place: Pose2) -> bool:
        count = max(2, math.ceil(wanted.distance_m(place) / SAMPLE_M))
        xs = np.linspace(wanted.x_m, place.x_m, count).tolist()
        ys = np.linspace(wanted.y_m, place.y_m, count).tolist()
        clearance = self._body.world.clearance
        return all(
            clearance.nearest_wall(x, y).distance_m > 0.0 for x, y in zip(xs, ys, strict=True)
        )
