# SPDX-License-Identifier: MIT
"""Lines by which a person at the keyboard carries the emulated LRF.

`carry BEARING DISTANCE TURN` puts it down where `ins-robot next` says: degrees to the left and
metres from where it stands and looks, then degrees to the left to look anew. It lands about
there, as a hand would put it (`simulation.person_std_m`, `simulation.person_std_deg`).
"""

from __future__ import annotations

import math

from ins_robot.errors import InputError
from ins_robot.simulation.person import Person

USAGE = "carry BEARING_DEG DISTANCE_M TURN_DEG, e.g. carry 35 2.3 -20 (left is positive)"
NUMBERS = 3


def obey(person: Person, line: str) -> str:
    """Do what the line says; what to answer."""
    try:
        bearing_deg, distance_m, turn_deg = _numbers(line)
        place = person.go(math.radians(bearing_deg), distance_m, math.radians(turn_deg))
    except InputError as error:
        return str(error)
    heading_deg = math.degrees(place.heading_rad)
    return f"put down at {place.x_m:.2f}, {place.y_m:.2f}, {heading_deg:.0f} deg in the world"


def _numbers(line: str) -> tuple[float, float, float]:
    order, *words = line.split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    is_finite = all(math.isfinite(value) for value in values)
    if order != "carry" or len(values) != NUMBERS or not is_finite or values[1] < 0.0:
        raise InputError(f"'{line.strip()}': expected {USAGE}")
    return values[0], values[1], values[2]
