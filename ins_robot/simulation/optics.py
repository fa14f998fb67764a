# SPDX-License-Identifier: MIT
"""What the XV-11 sees of the simulated world: ranges, strengths and losses, beam by beam.

Every beam is cast exactly, from where the body was at the beam's own time. The return grows
weaker with the square of range, slanted incidence and dark surfaces; too weak ones are lost.
Noise grows with the square of range (Konolige et al. 2008), edges give mixed pixels, and some
beams are lost for no reason, in short runs. The wall's part of it is the same in every run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import LrfConfig, SimulationConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.simulation.noise import Runs
from ins_robot.simulation.robot_body import RobotBody
from ins_robot.simulation.seen_area import SeenArea
from ins_robot.simulation.surfaces import Surfaces
from ins_robot.simulation.wire_device import OpticsReading
from ins_robot.simulation.world import World

BoolArray = NDArray[np.bool_]

# Error codes as the real sensor sends them; their meaning is a guess from when they occur.
CODE_NO_RETURN = 0x02
CODE_TOO_DIM = 0x21
CODE_TOO_NEAR = 0x03

RANGE_NEAR_M = 0.15
RANGE_FADES_M = 5.5
RANGE_GONE_M = 6.5
_STRENGTH_AT_1_M = 900.0
"""Strength a white wall seen squarely at 1 m would give; near ones saturate below it."""
_STRENGTH_MAX = 1000.0
_STRENGTH_LOST = 5.0
"""At this strength half of the beams are lost: a fair wall at 4 m seen at 81 deg."""
_LOSS_STEEPNESS = 3
_WEAK_FACING = 0.12
"""The warning: strength under this share of what is expected at that distance."""
_WEAK_STD_FACTOR = 2.0
_LOST_RUN_BEAMS = 2.5
_EDGE_M = 0.15
"""Neighbouring beams whose ranges differ by more have an edge between them."""
_QUANTUM_PER_M = 1000.0


class WorldOptics:
    """The LRF's eye on a body in a world.

    Bearings are in the lrf frame, whose axes are the base's: `lrf.yaw_deg` and the direction of
    rotation say which beam looks where, and are the emulator's and the driver's business.

    Attributes
    ----------
    seen : SeenArea
        What the readings so far really covered.
    """

    def __init__(
        self,
        world: World,
        body: RobotBody,
        lrf: LrfConfig,
        simulation: SimulationConfig,
        rng: np.random.Generator,
    ) -> None:
        self.seen = SeenArea(world)
        self._world = world
        self._body = body
        self._lrf = lrf
        self._simulation = simulation
        self._surfaces = Surfaces(world)
        self._rng, run_rng = rng.spawn(2)
        self._runs = Runs(run_rng, simulation.drop_out, _LOST_RUN_BEAMS)
        self._previous_m = RANGE_GONE_M

    def measure(self, stamps_s: FloatArray, bearings_rad: FloatArray) -> OpticsReading:
        """One reading for each of N beams at its own time; see `wire_device.Optics`."""
        x, y, direction = self._beams(stamps_s, bearings_rad)
        cos, sin = np.cos(direction), np.sin(direction)
        true_m, facing = self._look(x, y, direction, cos, sin)
        strength = np.minimum(_STRENGTH_AT_1_M * facing / true_m**2, _STRENGTH_MAX)
        lot = self._rng.random((4, true_m.size))
        is_gone = lot[0] * (RANGE_GONE_M - RANGE_FADES_M) < true_m - RANGE_FADES_M
        is_dim = lot[1] < self._loss(strength)
        is_lost = self._runs.draw(true_m.size)
        is_near = true_m < RANGE_NEAR_M
        is_weak = facing < _WEAK_FACING
        range_m = self._mixed(true_m, lot[2], lot[3])
        range_m = range_m + self._noise(range_m, is_weak)
        code = np.zeros(true_m.size, dtype=np.int64)
        code[is_dim] = CODE_TOO_DIM
        code[is_lost | is_gone] = CODE_NO_RETURN
        code[is_near] = CODE_TOO_NEAR
        is_valid = code == 0
        self._keep_seen(x, y, direction, true_m, is_valid)
        return OpticsReading(
            range_m=np.where(
                is_valid, np.round(range_m * _QUANTUM_PER_M) / _QUANTUM_PER_M, np.nan
            ),
            error_code=code,
            strength=np.where(code <= 0, strength, 0.0).astype(np.int64),
            is_weak=is_weak & is_valid,
        )

    def _beams(
        self, stamps_s: FloatArray, bearings_rad: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Origin (x, y) and direction of each beam, world frame, each (N,)."""
        x, y, heading = self._body.poses_at(stamps_s).T
        if self._lrf.x_m or self._lrf.y_m:
            cos, sin = np.cos(heading), np.sin(heading)
            x, y = (
                x + cos * self._lrf.x_m - sin * self._lrf.y_m,
                y + sin * self._lrf.x_m + cos * self._lrf.y_m,
            )
        return x, y, heading + bearings_rad

    def _look(
        self,
        x: FloatArray,
        y: FloatArray,
        direction: FloatArray,
        cos: FloatArray,
        sin: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """True range up to where sight ends, and reflectivity times cosine of incidence."""
        world = self._world
        scale = world.resolution_m
        starts = world.cells(np.stack([x, y], axis=1))
        sight = RANGE_GONE_M / scale
        reach = np.minimum(cast_rays(world.is_occupied, starts, direction, sight), sight)
        # The air half a cell before the face, and the wall itself.
        width = world.is_occupied.shape[1]
        flats = [
            (
                (starts[:, 0] + depth * sin).astype(np.int64) * width
                + (starts[:, 1] + depth * cos).astype(np.int64)
            )
            for depth in (reach - 0.5, reach + 0.1)
        ]
        facing = self._surfaces.incidence_cos(flats[0], cos, sin)
        facing *= self._surfaces.reflectivity(flats[1])
        return reach * scale, facing

    def _loss(self, strength: FloatArray) -> FloatArray:
        """(N,) probability that a return this weak is lost."""
        ratio = strength / _STRENGTH_LOST
        return self._simulation.drop_out_grazing / (1.0 + ratio**_LOSS_STEEPNESS)

    def _mixed(self, true_m: FloatArray, lot: FloatArray, where: FloatArray) -> FloatArray:
        """Ranges (N,) of which some beside an edge lie between its two sides."""
        before = np.concatenate([[self._previous_m], true_m[:-1]])
        self._previous_m = float(true_m[-1]) if true_m.size else self._previous_m
        is_edge = (
            (np.abs(true_m - before) > _EDGE_M) & np.isfinite(before) & np.isfinite(true_m)
        )
        is_mixed = is_edge & (lot < self._simulation.mixed_pixels)
        return np.where(is_mixed, before + where * (true_m - before), true_m)

    def _noise(self, range_m: FloatArray, is_weak: BoolArray) -> FloatArray:
        """(N,) error that grows with the square of range; more on weak returns."""
        floor, growth = self._simulation.range_std_floor_m, self._simulation.range_std_per_m2
        std = np.hypot(floor, growth * range_m**2) * np.where(is_weak, _WEAK_STD_FACTOR, 1.0)
        return std * self._rng.standard_normal(range_m.size)

    def _keep_seen(
        self,
        x: FloatArray,
        y: FloatArray,
        direction: FloatArray,
        true_m: FloatArray,
        ok: BoolArray,
    ) -> None:
        limit = self._lrf.range_max_m
        ok = ok | (true_m > limit)
        self.seen.add(x[ok], y[ok], direction[ok], np.minimum(true_m[ok], limit))
