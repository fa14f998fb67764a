# SPDX-License-Identifier: MIT
"""What the daemon and the replay share: odometry, survey, and the run they make."""
