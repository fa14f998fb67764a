# SPDX-License-Identifier: MIT
"""The occupancy grid, what can be asked of it, and the files it becomes."""
