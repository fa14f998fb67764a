# SPDX-License-Identifier: MIT
"""How much memory this process has needed at most."""

from __future__ import annotations

import math
import sys


def peak_rss_mb() -> float:
    """Peak resident set size in MB (2^20 bytes); NaN where the system does not tell."""
    try:
        import resource
    except ImportError:  # not a Unix
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)
