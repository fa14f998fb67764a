# SPDX-License-Identifier: MIT
"""Rows that are added one after the other and read all at once, without a list of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

FIRST = 16
GROWTH = 1.5  # more would leave more of it empty


class GrowingRows:
    """N rows of one shape and type in one array.

    Parameters
    ----------
    shape : tuple of int
        Of one row; () for a number.
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> None:
        self._array: NDArray[Any] = np.zeros((FIRST, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def all(self) -> NDArray[Any]:
        """(N, ...) view of the rows; may be written to, is stale once rows were added."""
        return self._array[: self._count]

    def cut(self, count: int) -> None:
        """Keep the first `count` rows only."""
        self._count = min(self._count, count)

    def add(self, row: Any) -> None:
        """Append one row."""
        self.extend(np.asarray(row)[None])

    def extend(self, rows: NDArray[Any]) -> None:
        """Append rows (M, ...)."""
        last = self._count + len(rows)
        if last > len(self._array):
            size = max(last, int(GROWTH * len(self._array)))
            larger = np.zeros((size, *self._array.shape[1:]), self._array.dtype)
            larger[: self._count] = self.all
            self._array = larger
        self._array[self._count : last] = rows
        self._count = last
