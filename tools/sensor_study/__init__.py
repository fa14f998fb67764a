# SPDX-License-Identifier: MIT
"""The simulated sensors held against recordings of real ones; see `tools/compare_sensor.py`."""
