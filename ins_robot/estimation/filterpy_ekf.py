# SPDX-License-Identifier: MIT
"""filterpy's extended Kalman filter without scipy.stats: 32 MB that nobody here uses.

All of `filterpy.kalman` asks `filterpy.stats` for one function, the log-likelihood of a
residual, and that module loads scipy.stats. Here it is loaded when the function is called.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

__all__ = ["ExtendedKalmanFilter"]


def _logpdf(*args: Any, **options: Any) -> Any:
    from filterpy.stats import logpdf

    return logpdf(*args, **options)


def _load() -> Any:
    name = "filterpy.stats"
    if name in sys.modules:
        from filterpy.kalman import ExtendedKalmanFilter
    else:
        stand_in = ModuleType(name)
        stand_in.__dict__["logpdf"] = _logpdf
        sys.modules[name] = stand_in
        try:
            from filterpy.kalman import ExtendedKalmanFilter
        finally:
            del sys.modules[name]
    return ExtendedKalmanFilter


ExtendedKalmanFilter = _load()
