# SPDX-License-Identifier: MIT
"""Recordings: our own journal, logs of other robots, and their replay."""
