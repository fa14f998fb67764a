# SPDX-License-Identifier: MIT
"""How much memory this process has used at its most."""

from __future__ import annotations

import sys

BYTES_PER_MB = 1024.0 * 1024.0
UNIT_BYTES = 1.0 if sys.platform == "darwin" else 1024.0


def peak_rss_mb() -> float:
    """Peak resident set in MB; NaN where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT_BYTES / BYTES_PER_MB
