# SPDX-License-Identifier: MIT
"""The process that runs the robot."""
