# SPDX-License-Identifier: MIT
"""What a run of the benchmark leaves behind: how far, how long, how much was seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

MARKS = (0.90, 0.95, 0.99)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """What driving, turning on the motor and scanning cost."""

    speed_mps: float
    scan_s: float


@dataclass(slots=True)
class Track:
    """A run, readable while it goes."""

    pace: Pace
    path_m: float = 0.0
    stops: int = 0
    turning_rad: float = 0.0
    decide_ms: list[float] = field(default_factory=list)
    home_m: float | None = None
    clearance_min_m: float | None = None
    contacts: int = 0
    failure: str | None = None
    end: str = ""
    curve: list[tuple[float, float, float]] = field(default_factory=list)
    marks: dict[float, tuple[float, float, int]] = field(default_factory=dict)

    @property
    def time_s(self) -> float:
        """Driving and scanning so far."""
        return self.path_m / self.pace.speed_mps + self.stops * self.pace.scan_s

    @property
    def coverage(self) -> float:
        """Share seen so far."""
        return self.curve[-1][2] if self.curve else 0.0

    def saw(self, coverage: float) -> None:
        """Note the share seen at this point of the way."""
        self.curve.append((round(self.path_m, 3), round(self.time_s, 2), round(coverage, 5)))
        for mark in MARKS:
            if coverage >= mark:
                self.marks.setdefault(mark, (self.path_m, self.time_s, self.stops))

    def as_json(self) -> dict[str, object]:
        """The result line's figures; lengths to a mark are None where it was missed."""
        found: dict[str, object] = {}
        for mark in MARKS:
            path = self.marks[mark][0] if mark in self.marks else None
            found[f"l{100 * mark:.0f}_m"] = None if path is None else round(path, 3)
        has_99 = self.marks.get(0.99)
        times = self.decide_ms or [math.nan]
        return found | {
            "coverage": round(self.coverage, 5),
            "stops": self.stops,
            "decisions": len(self.decide_ms),
            "time_s": round(self.time_s, 1),
            "time99_s": None if has_99 is None else round(has_99[1], 1),
            "stops99": None if has_99 is None else has_99[2],
            "path_m": round(self.path_m, 3),
            "turning_rad": round(self.turning_rad, 2),
            "ms_per_decision": round(float(np.median(times)), 2),
            "ms_worst": round(max(times), 1),
            "home_m": None if self.home_m is None else round(self.home_m, 2),
            "clearance_min_m": (
                None if self.clearance_min_m is None else round(self.clearance_min_m, 3)
            ),
            "contacts": self.contacts,
            "failure": self.failure,
            "end": self.end,
        }
