# SPDX-License-Identifier: MIT
"""From a planned path to wheel speeds, and what may stop them."""
