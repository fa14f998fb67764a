# SPDX-License-Identifier: MIT
"""A robot that explores an unknown building by itself and comes back with a 2-D map."""

__version__ = "0.1.0"
