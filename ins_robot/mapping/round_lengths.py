# SPDX-License-Identifier: MIT
"""Lengths that are read at a glance, for scale bars and rings: 1, 2 or 5 x 10^n."""

from __future__ import annotations

import math

ROUNDING = 1.0 + 1e-9  # a length that is round but for its last digit is round


def round_below(length: float) -> float:
    """The longest that is not longer."""
    return max(step for step in _steps_about(length) if step <= length * ROUNDING)


def round_above(length: float) -> float:
    """The shortest that is not shorter."""
    return min(step for step in _steps_about(length) if step * ROUNDING >= length)


def _steps_about(length: float) -> list[float]:
    power = 10.0 ** math.floor(math.log10(length))
    return [step * power for step in (1.0, 2.0, 5.0, 10.0)]
