# SPDX-License-Identifier: MIT
"""A `Config` to TOML: bare, as it is recorded, and the commented reference, `config.toml`."""

from __future__ import annotations

import dataclasses

from ins_robot.config.all_sections import Config
from ins_robot.config.option import limits, toml_value


def to_toml(config: Config) -> str:
    """The whole configuration as TOML without comments; `load` reads it back equal."""
    lines: list[str] = []
    for section in dataclasses.fields(config):
        values = getattr(config, section.name)
        lines.append(f"[{section.name}]")
        lines += [
            f"{f.name} = {toml_value(getattr(values, f.name))}"
            for f in dataclasses.fields(values)
        ]
        lines.append("")
    return "\n".join(lines)


def reference_toml() -> str:
    """The commented reference configuration: every option, its default, bounds and reason."""
    config = Config()
    lines = [
        "# Every option with its default. Copy what you change into your own file;",
        "# `ins-robot check-config FILE` checks it. Units are in the names.",
        "",
    ]
    for section in dataclasses.fields(config):
        values = getattr(config, section.name)
        doc = (type(values).__doc__ or "").strip()
        lines += [f"# {doc}", f"[{section.name}]"]
        for f in dataclasses.fields(values):
            note = "; ".join(part for part in (f.metadata["doc"], limits(f.metadata)) if part)
            if note:
                lines.append(f"# {note}")
            lines.append(f"{f.name} = {toml_value(getattr(values, f.name))}")
        lines.append("")
    return "\n".join(lines)
