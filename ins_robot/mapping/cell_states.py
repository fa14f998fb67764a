# SPDX-License-Identifier: MIT
"""What the log-odds of cells say: unknown, and solid; log-odds in, masks out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ins_robot.mapping.neighbourhood import grown

BoolArray = NDArray[np.bool_]
Float32Array = NDArray[np.float32]

KNOWN_LOG_ODDS = 0.05  # less evidence than this says nothing (the weakest miss is 0.1)
OCCUPIED_LOG_ODDS = 0.2  # one weak far hit is not yet a wall
CROSSED_LOG_ODDS = -1.0  # below: at least three scans have looked through, five if one hit it


def unknown(log_odds: Float32Array) -> BoolArray:
    """Neither free nor occupied."""
    return (log_odds >= -KNOWN_LOG_ODDS) & (log_odds <= OCCUPIED_LOG_ODDS)


def solid(log_odds: Float32Array, is_quiet: BoolArray) -> BoolArray:
    """Occupied, or unknown right beside it where no silent beam has passed."""
    occupied = log_odds > OCCUPIED_LOG_ODDS
    return occupied | (unknown(log_odds) & grown(occupied) & ~is_quiet)
