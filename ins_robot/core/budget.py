# SPDX-License-Identifier: MIT
"""When exploring must end so that the way home can still be driven: what is spent in, why out.

Time, distance and battery have a limit each; the way home, as far as the map knows it, and some
more are kept back of the first two.
"""

from __future__ import annotations

import math

from ins_robot.config import Config

TIME_SLACK = 2.0  # a way takes up to so many times what cruising would: turns, looks, guard
TIME_KEPT_S = 20.0  # and the scan at home
WAY_SLACK = 1.15
BATTERY_SHARE = 0.002  # of each telemetry frame: a drop of load must last for 10 s


class Budget:
    """The limits of one run."""

    def __init__(self, config: Config) -> None:
        self._exploration = config.exploration
        self._cruise_mps = config.control.cruise_mps
        self._battery_min_v = config.wheels.battery_low_v + config.exploration.battery_reserve_v
        self._has_battery_limit = config.wheels.battery_low_v > 0.0
        self._battery_v = math.nan  # smoothed; NaN where it is not measured

    def weigh_battery(self, volts: float) -> None:
        """What a telemetry frame says; NaN: nothing."""
        if math.isnan(self._battery_v):
            self._battery_v = volts
        elif not math.isnan(volts):
            self._battery_v += BATTERY_SHARE * (volts - self._battery_v)

    def why_home(self, duration_s: float, driven_m: float, way_m: float) -> str | None:
        """Why exploring must end now, with `way_m` still to drive; None: it need not."""
        limits = self._exploration
        if not limits.return_home:
            way_m = 0.0
        kept_s = (TIME_SLACK * way_m / self._cruise_mps + TIME_KEPT_S) if way_m else 0.0
        if duration_s + kept_s > limits.max_time_s:
            return f"exploration.max_time_s = {limits.max_time_s:g} s is used up"
        if limits.max_distance_m > 0.0 and driven_m + WAY_SLACK * way_m > limits.max_distance_m:
            return f"exploration.max_distance_m = {limits.max_distance_m:g} m is used up"
        if self._has_battery_limit and self._battery_v < self._battery_min_v:
            at_v, end_v = self._battery_v, self._battery_min_v
            return f"battery at {at_v:.1f} V, exploring ends at {end_v:.1f} V"
        return None
