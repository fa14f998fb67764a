# SPDX-License-Identifier: MIT
"""How much memory this process has used at its most."""

from __future__ import annotations

import sys
from pathlib import Path

BYTES_PER_MB = 1024.0 * 1024.0
UNIT_BYTES = 1.0 if sys.platform == "darwin" else 1024.0
STATUS = Path("/proc/self/status")


def peak_rss_mb() -> float:
    """Peak resident set in MB; NaN where the system does not tell (Windows)."""
    # Linux: getrusage would count what the parent held when it forked us.
    if STATUS.exists():
        for line in STATUS.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    try:
        import resource
    except ImportError:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT_BYTES / BYTES_PER_MB
