# SPDX-License-Identifier: MIT
"""The error characteristic of the LRF (the paper's figure 3): how far single ranges scatter.

The one law for the sensor model (drivers, readers of logs) and for the simulated sensor; pure.
A triangulating sensor turns the place of a light spot into a range, so an error of that place
counts with r^2 (Konolige et al. 2008); the light that comes back weakens with r^2, and with the
root of it the place is found. Together r^3: the exponent fitted to a standing robot's readings
is 2.95 +- 0.05 from 0.5 m to 5 m (`tools/compare_sensor.py`); the square is refused.
"""

from __future__ import annotations

import numpy as np

from ins_robot.geometry.angles import FloatArray


def range_std_m(ranges_m: FloatArray, floor_m: float, per_m3: float | FloatArray) -> FloatArray:
    """Standard deviation of single readings, shape as `ranges_m`; NaN with the range.

    Parameters
    ----------
    ranges_m : (...,) float64
    floor_m : float
        What is left at no distance at all: quantisation, and, for who must trust the reading,
        calibration.
    per_m3 : float or (...,) float64
        Growth with the cube of range, metres per cubic metre.
    """
    std_m: FloatArray = np.hypot(floor_m, per_m3 * ranges_m * ranges_m * ranges_m)
    return std_m
