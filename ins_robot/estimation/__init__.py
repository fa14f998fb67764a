# SPDX-License-Identifier: MIT
"""Where the robot is: Kalman filter, particle filter, SLAM."""
