# SPDX-License-Identifier: MIT
"""What the XV-11 sees of the simulated world: ranges, strengths and losses, beam by beam.

Every beam is cast exactly, from where the body was at the beam's own time. The return grows
weaker with the square of range, slanted incidence and dark surfaces; too weak ones are lost,
others are noisier (`sensing.range_error`). Edges give mixed pixels, and some beams are lost for
no reason, in short runs. The wall's part of it is the same in every run. What the figures come
from, and how near they are: `tools/compare_sensor.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ins_robot.config import LrfConfig, SimulationConfig
from ins_robot.geometry.angles import FloatArray
from ins_robot.mapping.ray_cast import cast_rays
from ins_robot.sensing.range_error import range_std_m
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
_DROP_OUT_CODES = np.array([CODE_NO_RETURN, CODE_TOO_DIM, 0x35, CODE_TOO_NEAR, 0x25])
_DROP_OUT_SHARES = np.array([0.22, 0.33, 0.33, 0.10, 0.02])  # of a real sensor in a box

RANGE_NEAR_M = 0.15
RANGE_FADES_M = 5.5
RANGE_GONE_M = 6.5
_STRENGTH_AT_1_M = 180.0
"""Strength of a white wall seen squarely at 1 m; a real sensor in a box: 76 to 104, r^-2."""
_STRENGTH_MAX = 1000.0
_LOSS_STEEPNESS = 8
"""A beam is lost or not: few in a real room come and go (Botvac: 6 % of the beams)."""
_WEAK_FACING = 0.12
"""The warning: strength under this share of what is expected at that distance."""
_MIDDLING_FACING = 0.45
"""The fitted growth of noise belongs to this; others: by the root, as photons are counted."""
_FACING_MIN = 0.02
_LOST_RUN_BEAMS = 2.5
_EDGE_M = 0.15
"""Ranges of neighbours differ by this much more than on one slanted wall: an edge."""
_BEAM_PITCH_RAD = np.radians(1.0)
_COS_MIN = 0.02
_QUANTUM_M = 1e-3


class _Beams(NamedTuple):
    """Where N beams start and look, world frame, each (N,)."""

    x_m: FloatArray
    y_m: FloatArray
    direction_rad: FloatArray
    cos: FloatArray
    sin: FloatArray


class _Wall(NamedTuple):
    """What stops N beams, each (N,)."""

    range_m: FloatArray
    incidence_cos: FloatArray
    reflectivity: FloatArray


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
        self._surfaces = Surfaces(world, simulation.reflectivity_spread)
        self._rng, run_rng = rng.spawn(2)
        self._runs = Runs(run_rng, simulation.drop_out, _LOST_RUN_BEAMS)
        self._previous_m, self._previous_slope_m = RANGE_GONE_M, 0.0

    def measure(self, stamps_s: FloatArray, bearings_rad: FloatArray) -> OpticsReading:
        """One reading for each of N beams at its own time; see `wire_device.Optics`."""
        beams = self._beams(stamps_s, bearings_rad)
        wall = self._look(beams)
        facing = wall.incidence_cos * wall.reflectivity
        strength = _STRENGTH_AT_1_M * facing / np.maximum(wall.range_m, RANGE_NEAR_M) ** 2
        lots = self._rng.random((5, facing.size))
        code = self._losses(wall.range_m, strength, lots[0], lots[1], lots[4])
        is_valid = code == 0
        is_weak = facing < _WEAK_FACING
        range_m = self._mixed(wall, lots[2], lots[3])
        range_m = range_m + self._noise(range_m, facing)
        self._keep_seen(beams, wall.range_m, is_valid)
        has_strength = is_valid | (code == CODE_TOO_DIM)
        return OpticsReading(
            range_m=np.where(is_valid, np.rint(range_m / _QUANTUM_M) * _QUANTUM_M, np.nan),
            error_code=code,
            strength=(np.minimum(strength, _STRENGTH_MAX) * has_strength).astype(np.int64),
            is_weak=is_weak & is_valid,
        )

    def _beams(self, stamps_s: FloatArray, bearings_rad: FloatArray) -> _Beams:
        x, y, heading = self._body.poses_at(stamps_s).T
        if self._lrf.x_m or self._lrf.y_m:
            cos, sin = np.cos(heading), np.sin(heading)
            x, y = (
                x + cos * self._lrf.x_m - sin * self._lrf.y_m,
                y + sin * self._lrf.x_m + cos * self._lrf.y_m,
            )
        direction = heading + bearings_rad
        return _Beams(x, y, direction, np.cos(direction), np.sin(direction))

    def _look(self, beams: _Beams) -> _Wall:
        """Where each beam ends; beams that end nowhere in sight end where sight does."""
        walls, scale = self._world.is_occupied, self._world.resolution_m
        starts = self._world.cells(np.stack([beams.x_m, beams.y_m], axis=1))
        sight = RANGE_GONE_M / scale
        reach = np.minimum(cast_rays(walls, starts, beams.direction_rad, sight), sight)

        def cells_at(depth: FloatArray) -> NDArray[np.int64]:
            rows = (starts[:, 0] + depth * beams.sin).astype(np.int64)
            cols = (starts[:, 1] + depth * beams.cos).astype(np.int64)
            flat: NDArray[np.int64] = rows * walls.shape[1] + cols
            return flat

        # Walls face the air half a cell before them; what they are made of lies in them.
        return _Wall(
            reach * scale,
            self._surfaces.incidence_cos(cells_at(reach - 0.5), beams.cos, beams.sin),
            self._surfaces.reflectivity(cells_at(reach + 0.1)),
        )

    def _losses(
        self,
        true_m: FloatArray,
        strength: FloatArray,
        far: FloatArray,
        dim: FloatArray,
        why: FloatArray,
    ) -> NDArray[np.int64]:
        """(N,) error codes, 0 for beams that come back; the last three are uniform lots."""
        # Half of the beams are lost at `strength_lost`, ever more below it.
        odds = (strength / self._simulation.strength_lost) ** _LOSS_STEEPNESS
        code = np.zeros(true_m.size, dtype=np.int64)
        code[dim < self._simulation.drop_out_grazing / (1.0 + odds)] = CODE_TOO_DIM
        code[far * (RANGE_GONE_M - RANGE_FADES_M) < true_m - RANGE_FADES_M] = CODE_NO_RETURN
        is_out = self._runs.draw(true_m.size)
        kind = np.searchsorted(np.cumsum(_DROP_OUT_SHARES[:-1]), why[is_out], side="right")
        code[is_out] = _DROP_OUT_CODES[kind]
        code[true_m < RANGE_NEAR_M] = CODE_TOO_NEAR
        return code

    def _mixed(self, wall: _Wall, lot: FloatArray, where: FloatArray) -> FloatArray:
        """Ranges (N,) of which some beside an edge lie between its two sides."""
        true_m = wall.range_m
        slope_m = _BEAM_PITCH_RAD * true_m / np.maximum(wall.incidence_cos, _COS_MIN)
        ranges = np.concatenate([[self._previous_m], true_m])
        slopes = np.concatenate([[self._previous_slope_m], slope_m])
        self._previous_m, self._previous_slope_m = float(ranges[-1]), float(slopes[-1])
        before_m = ranges[:-1]
        is_edge = np.abs(true_m - before_m) > _EDGE_M + slope_m + slopes[:-1]
        is_edge &= np.maximum(true_m, before_m) < RANGE_GONE_M
        is_mixed = is_edge & (lot < self._simulation.mixed_pixels)
        return np.where(is_mixed, before_m + where * (true_m - before_m), true_m)

    def _noise(self, range_m: FloatArray, facing: FloatArray) -> FloatArray:
        """(N,) error that grows with range; more where little light comes back."""
        floor_m, growth = self._simulation.range_std_floor_m, self._simulation.range_std_per_m3
        dimness = np.sqrt(_MIDDLING_FACING / np.maximum(facing, _FACING_MIN))
        std_m = range_std_m(range_m, floor_m, growth * dimness)
        return std_m * self._rng.standard_normal(range_m.size)

    def _keep_seen(self, beams: _Beams, true_m: FloatArray, is_valid: BoolArray) -> None:
        limit_m = self._lrf.range_max_m
        ok = is_valid | (true_m > limit_m)
        length_m = np.minimum(true_m[ok], limit_m)
        self.seen.add(beams.x_m[ok], beams.y_m[ok], beams.direction_rad[ok], length_m)
