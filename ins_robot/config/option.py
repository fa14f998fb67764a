# SPDX-License-Identifier: MIT
"""One option: how it is declared, when a value is refused, how value and limits are told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

from ins_robot.outline import Corners

NO_POLYGON = "none"


def option(
    default: Any,
    doc: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """Declare one option: default, one line of reason, and what it may be."""
    metadata = {
        "doc": doc,
        "above": above,
        "at_least": at_least,
        "at_most": at_most,
        "choices": choices,
    }
    return field(default=default, metadata=metadata)


def checked(value: Any, kind: Any, bounds: Mapping[str, Any]) -> Any:
    """The value in its declared type, or ValueError that says what it must be."""
    if kind is bool:
        if not isinstance(value, bool):
            raise ValueError("must be true or false")
        return value
    if kind is str:
        if not isinstance(value, str):
            raise ValueError('must be text in quotes, "..."')
        choices = bounds["choices"]
        if choices and value not in choices:
            raise ValueError("must be one of " + ", ".join(f'"{c}"' for c in choices))
        return value if choices else _path(value)
    if kind is int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise ValueError("must be a whole number")
        return _bounded(value, bounds)
    if kind is float:
        return _bounded(_number(value), bounds)
    return _corners(value) if kind == Corners | None else _numbers(value, bounds)


def _path(value: str) -> str:
    """Text without choices names a device, file or directory; `~` is the home directory."""
    if not value.strip():
        raise ValueError("must not be empty")
    try:
        return str(Path(value).expanduser()) if value.startswith("~") else value
    except RuntimeError:
        raise ValueError("no home directory is known for it") from None


def _numbers(value: Any, bounds: Mapping[str, Any]) -> tuple[float, ...]:
    if not isinstance(value, list | tuple):
        raise ValueError("must be a list of numbers, [a, b, ...]")
    return tuple(_bounded(_number(v), bounds) for v in value)


def _corners(value: Any) -> Corners | None:
    if value is None or value == NO_POLYGON:
        return None
    if not isinstance(value, list | tuple) or not all(
        isinstance(corner, list | tuple) and len(corner) == 2  # noqa: PLR2004 - x and y
        for corner in value
    ):
        raise ValueError(f'must be a list of corners, [[x, y], ...], or "{NO_POLYGON}"')
    return tuple((_number(x), _number(y)) for x, y in value)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("must be a number")
    if not math.isfinite(value):
        raise ValueError("must be finite")
    return float(value)


def _bounded(value: Any, bounds: Mapping[str, Any]) -> Any:
    if bounds["above"] is not None and not value > bounds["above"]:
        raise ValueError(f"must be above {bounds['above']:g}")
    if bounds["at_least"] is not None and not value >= bounds["at_least"]:
        raise ValueError(f"must be at least {bounds['at_least']:g}")
    if bounds["at_most"] is not None and not value <= bounds["at_most"]:
        raise ValueError(f"must be at most {bounds['at_most']:g}")
    return value


def limits(bounds: Mapping[str, Any]) -> str:
    """What a value may be, for the reference; empty when anything of its type will do."""
    if bounds["choices"]:
        return "one of " + ", ".join(f'"{c}"' for c in bounds["choices"])
    parts = [
        f"{word} {bounds[key]:g}"
        for key, word in (("above", "above"), ("at_least", "at least"), ("at_most", "at most"))
        if bounds[key] is not None
    ]
    return "[" + ", ".join(parts) + "]" if parts else ""


def toml_value(value: Any) -> str:
    """One value as TOML."""
    if value is None:
        return toml_value(NO_POLYGON)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return repr(value)
