# SPDX-License-Identifier: MIT
"""Whether exploring gets anywhere: the seen area at each decision in, "it does not" out.

Two goals that take turns in being the best one would keep the robot busy for ever. Seen ground
is finite, so decisions that show none must end; what they were for is then refused.
"""

from __future__ import annotations

import math

PATIENCE = 6  # decisions in a row
GROWTH_M2 = 0.1  # less than this is nothing


class Progress:
    """Counts decisions since the map has last grown."""

    def __init__(self) -> None:
        self._seen_m2 = -math.inf
        self._count = 0

    def is_stalled(self, seen_m2: float) -> bool:
        """Take note of one more decision; True after `PATIENCE` without growth."""
        if seen_m2 >= self._seen_m2 + GROWTH_M2:
            self._seen_m2, self._count = seen_m2, 0
            return False
        self._count += 1
        if self._count < PATIENCE:
            return False
        self._seen_m2, self._count = seen_m2, 0
        return True
