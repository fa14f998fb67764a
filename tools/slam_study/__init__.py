# SPDX-License-Identifier: MIT
"""Estimators on public logs, scored and timed; see `tools/benchmark_slam.py`."""
