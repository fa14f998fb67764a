# SPDX-License-Identifier: MIT
"""Noise that is drawn in blocks and handed out one value at a time as plain floats.

A call of a numpy Generator costs about as much as a whole step of the body otherwise does.
Each source owns its generator: what one draws ahead never changes the values of another.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512


class GaussianSource:
    """Independent standard normal values."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._values: list[float] = []

    def draw(self) -> float:
        """The next value."""
        if not self._values:
            self._values = self._rng.standard_normal(_BLOCK).tolist()
        return self._values.pop()


class OrnsteinUhlenbeck:
    """Noise with a memory: a standard normal value that forgets itself over `time_s`."""

    def __init__(self, source: GaussianSource, time_s: float) -> None:
        self._source = source
        self._time_s = time_s
        self._dt_s = math.nan
        self._keep = self._add = 0.0
        self.value = source.draw()

    def step(self, dt_s: float) -> float:
        """The value `dt_s` later; exact for any step."""
        if dt_s != self._dt_s:
            self._dt_s = dt_s
            self._keep = math.exp(-dt_s / self._time_s)
            self._add = math.sqrt(1.0 - self._keep * self._keep)
        self.value = self._keep * self.value + self._add * self._source.draw()
        return self.value


class Runs:
    """A share of True values that come in runs of a mean length, as beams are lost."""

    def __init__(self, rng: np.random.Generator, share: float, mean_length: float) -> None:
        self._rng = rng
        self._share = share
        self._mean_length = mean_length
        self._values = np.zeros(0, dtype=bool)

    def draw(self, count: int) -> NDArray[np.bool_]:
        """The next `count` values, (count,) bool."""
        if self._share in (0.0, 1.0):
            return np.full(count, self._share == 1.0)
        while self._values.size < count:
            self._values = np.concatenate([self._values, self._block()])
        head, self._values = self._values[:count], self._values[count:]
        return head

    def _block(self) -> NDArray[np.bool_]:
        # Gaps so long that runs make up the share.
        gap = max(1.0, self._mean_length * (1.0 - self._share) / self._share)
        lengths = np.stack(
            [
                self._rng.geometric(1.0 / gap, _BLOCK),
                self._rng.geometric(1.0 / self._mean_length, _BLOCK),
            ],
            axis=1,
        )
        return np.repeat(np.tile([False, True], _BLOCK), lengths.reshape(-1))
