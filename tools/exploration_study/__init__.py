# SPDX-License-Identifier: MIT
"""Parts of `tools/benchmark_exploration.py`: robots that explore, jobs, tables and pictures."""
