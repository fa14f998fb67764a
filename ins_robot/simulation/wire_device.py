# SPDX-License-Identifier: MIT
"""The seams of the simulator: what a device is to its wire, and what it asks of the world.

A `WireDevice` hangs on a serial line (in memory or on a pty), a `RegisterDevice` on an I2C bus.
Both live on the time they are told. `Optics` is what the laser range finder (LRF) sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ins_robot.geometry.angles import FloatArray


class WireDevice(Protocol):
    """A device on a serial line."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes from the host, arriving now. `now_s` never goes back."""
        ...

    def advance(self, now_s: float) -> bytes:
        """Live until `now_s`; the bytes sent since the last call, b"" for none."""
        ...


class RegisterDevice(Protocol):
    """A device on an I2C bus."""

    address: int

    def read(self, register: int, length: int, now_s: float) -> bytes:
        """Burst read of `length` bytes from `register` on."""
        ...

    def write(self, register: int, data: bytes, now_s: float) -> None:
        """Burst write from `register` on."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsReading:
    """What N beams saw.

    Attributes
    ----------
    range_m : (N,) float64
        NaN where there is no distance.
    error_code : (N,) int64
        The sensor's code where there is no distance (any byte), 0 where there is one.
    strength : (N,) int64
        Signal strength, 0..65535.
    is_weak : (N,) bool
        The strength warning; never where there is no distance.
    """

    range_m: FloatArray
    error_code: np.ndarray
    strength: np.ndarray
    is_weak: np.ndarray


class Optics(Protocol):
    """The world as the LRF sees it."""

    def measure(self, stamps_s: FloatArray, bearings_rad: FloatArray) -> OpticsReading:
        """One reading for each of N beams.

        Parameters
        ----------
        stamps_s : (N,) float64
            When each beam was measured; ascending, none later than the present.
        bearings_rad : (N,) float64
            Counter-clockwise from the LRF's x axis, wrapped to [-pi, pi).
        """
        ...
