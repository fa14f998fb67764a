# SPDX-License-Identifier: MIT
"""A world, a robot body and its devices, speaking the same bytes as the real ones."""
