# SPDX-License-Identifier: MIT
"""One quantity of a sensor, as recorded and as simulated.

A part is a recording, a half of one, or one standstill: what real parts differ by among
themselves is what the simulator may differ by.
"""

from __future__ import annotations

from dataclasses import dataclass

from ins_robot.geometry.angles import FloatArray


@dataclass(frozen=True)
class Quantity:
    """Values of one quantity, `real` by part and `simulated` by seed.

    `source` names the recordings, `caveat` what they cannot tell.
    """

    name: str
    unit: str
    source: str
    caveat: str
    real: list[FloatArray]
    simulated: list[FloatArray]
