# SPDX-License-Identifier: MIT
"""How the daemon's parts are doing: rates, ages, durations and counters.

Every task reports here with one cheap call; once a second `roll` closes the window that rates
and durations are taken over. Out come one stats line for the log and a dict for `status`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

MS_PER_S = 1e3


@dataclass(slots=True)
class Stream:
    """Data that come again and again; stale when silent for `stale_after_s` (None: never)."""

    stale_after_s: float | None = None
    last_s: float | None = None
    total: int = 0
    rate_hz: float = 0.0
    _rolled_total: int = 0

    def age_s(self, now_s: float) -> float | None:
        """Time since the last datum; None before the first."""
        return None if self.last_s is None else now_s - self.last_s

    def roll(self, elapsed_s: float) -> None:
        """Take the rate over the window that ends now."""
        self.rate_hz = (self.total - self._rolled_total) / elapsed_s
        self._rolled_total = self.total


@dataclass(slots=True)
class Timing:
    """How long something takes: in the open window, in the last full one, and ever."""

    mean_s: float = 0.0
    worst_s: float = 0.0
    worst_ever_s: float = 0.0
    _sum_s: float = 0.0
    _count: int = 0
    _window_worst_s: float = 0.0

    def took(self, duration_s: float) -> None:
        """One pass took this long."""
        self._sum_s += duration_s
        self._count += 1
        self._window_worst_s = max(self._window_worst_s, duration_s)
        self.worst_ever_s = max(self.worst_ever_s, duration_s)

    def roll(self) -> None:
        """Show the window that ends now, and open the next."""
        self.mean_s = self._sum_s / self._count if self._count else 0.0
        self.worst_s = self._window_worst_s
        self._sum_s, self._count, self._window_worst_s = 0.0, 0, 0.0


@dataclass(slots=True)
class Health:
    """The record of a daemon that began at `began_s` (loop time).

    Streams and timings are made by the first report under their name, or by `expect`.
    """

    began_s: float
    streams: dict[str, Stream] = field(default_factory=dict)
    timings: dict[str, Timing] = field(default_factory=dict)
    counters: dict[str, int] = field(default_factory=dict)
    _rolled_s: float | None = None

    def expect(self, name: str, stale_after_s: float | None) -> None:
        """Declare a stream, and how long it may be silent (None: for ever)."""
        self.streams.setdefault(name, Stream()).stale_after_s = stale_after_s

    def beat(self, name: str, now_s: float) -> None:
        """One datum of the stream has come, or one tick was done."""
        stream = self.streams.get(name)
        if stream is None:
            stream = self.streams[name] = Stream()
        stream.last_s = now_s
        stream.total += 1

    def took(self, name: str, duration_s: float) -> None:
        """One pass of something took this long."""
        timing = self.timings.get(name)
        if timing is None:
            timing = self.timings[name] = Timing()
        timing.took(duration_s)

    def count(self, name: str, amount: int = 1) -> None:
        """Count an event, such as a verdict or a dropped scan."""
        self.counters[name] = self.counters.get(name, 0) + amount

    def stale(self, now_s: float) -> list[str]:
        """The streams silent for too long; before its first datum one is as old as we are."""
        names = []
        for name, stream in self.streams.items():
            heard_s = self.began_s if stream.last_s is None else stream.last_s
            if stream.stale_after_s is not None and now_s - heard_s > stream.stale_after_s:
                names.append(name)
        return names

    def roll(self, now_s: float) -> None:
        """Close the window: what is shown from now on is of the data that came in it."""
        elapsed_s = now_s - (self.began_s if self._rolled_s is None else self._rolled_s)
        if elapsed_s <= 0.0:
            return
        self._rolled_s = now_s
        for stream in self.streams.values():
            stream.roll(elapsed_s)
        for timing in self.timings.values():
            timing.roll()

    def line(self, now_s: float) -> str:
        """The stats line: `stats: up 12 s, imu 50.0 Hz, ..., slam 9.4/31.0 ms, STALE: imu`."""
        parts = [f"up {now_s - self.began_s:.0f} s"]
        parts += [f"{name} {stream.rate_hz:.1f} Hz" for name, stream in self.streams.items()]
        parts += [
            f"{name} {timing.mean_s * MS_PER_S:.1f}/{timing.worst_s * MS_PER_S:.1f} ms"
            for name, timing in self.timings.items()
        ]
        parts += [f"{name} {value}" for name, value in self.counters.items()]
        stale = self.stale(now_s)
        if stale:
            parts.append("STALE: " + " ".join(stale))
        return "stats: " + ", ".join(parts)

    def as_dict(self, now_s: float) -> dict[str, Any]:
        """The same, and more, as JSON values."""
        return {
            "uptime_s": round(now_s - self.began_s, 3),
            "rates_hz": {name: round(s.rate_hz, 2) for name, s in self.streams.items()},
            "ages_s": {name: _rounded(s.age_s(now_s)) for name, s in self.streams.items()},
            "durations_ms": {
                name: {
                    "mean": round(timing.mean_s * MS_PER_S, 3),
                    "worst": round(timing.worst_s * MS_PER_S, 3),
                    "worst_ever": round(timing.worst_ever_s * MS_PER_S, 3),
                }
                for name, timing in self.timings.items()
            },
            "counters": dict(self.counters),
            "stale": self.stale(now_s),
        }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
