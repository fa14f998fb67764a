# SPDX-License-Identifier: MIT
"""Angles and rigid motions of the plane: float64, SI, radians."""
