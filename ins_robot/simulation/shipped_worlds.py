# SPDX-License-Identifier: MIT
"""The worlds that ship with the simulator, by name."""

from __future__ import annotations

from pathlib import Path

DIRECTORY = Path(__file__).parent / "worlds"


def shipped_worlds() -> list[str]:
    """Their names, sorted."""
    return sorted(path.stem for path in DIRECTORY.glob("*.yaml"))
