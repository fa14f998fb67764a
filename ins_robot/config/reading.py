# SPDX-License-Identifier: MIT
"""TOML and `--set` to a `Config`: refuses unknown keys and wrong values, repairs nothing."""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, get_type_hints

from ins_robot.config.all_sections import Config
from ins_robot.config.option import checked, toml_value
from ins_robot.errors import ConfigError


def load(path: Path | None, overrides: Iterable[str] = ()) -> Config:
    """Read a configuration file (None: defaults) and apply `section.key=value` overrides.

    Raises
    ------
    ConfigError
        One line for each flaw: what is wrong, where, and what it may be.
    """
    base = Config() if path is None else from_tables(_read_toml(path), str(path))
    return with_overrides(base, overrides)


def loads(text: str, where: str) -> Config:
    """Read a configuration from TOML text; `where` names it in errors."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where}: not TOML: {error}") from None
    return from_tables(tables, where)


def with_overrides(config: Config, overrides: Iterable[str]) -> Config:
    """Apply `section.key=value` overrides, the ones of `--set`."""
    wanted: dict[str, dict[str, Any]] = {}
    for override in overrides:  # all together: two options may need each other's new value
        for section, table in _override_table(override).items():
            wanted.setdefault(section, {}).update(table)
    return from_tables(wanted, "--set", base=config) if wanted else config


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such configuration file") from None
    except IsADirectoryError:
        raise ConfigError(f"{path}: is a directory, not a configuration file") from None
    except PermissionError:
        raise ConfigError(f"{path}: may not be read by this user") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None


def _override_table(override: str) -> dict[str, dict[str, Any]]:
    name, equals, text = override.partition("=")
    section, dot, key = name.strip().partition(".")
    if not equals or not dot or not key:
        raise ConfigError(f"--set {override}: expected section.key=value, e.g. lrf.rpm=250")
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a bare word is a string
    return {section: {key: value}}


def from_tables(tables: Mapping[str, Any], where: str, base: Config | None = None) -> Config:
    """Build a `Config` from parsed TOML, on top of `base` (default: the defaults)."""
    base = base or Config()
    sections = {f.name: getattr(base, f.name) for f in dataclasses.fields(Config)}
    flaws: list[str] = []
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            owner = next((n for n, s in sections.items() if hasattr(s, name)), "robot")
            flaws.append(
                f"'{name}' stands outside of any section; an option belongs below the line "
                f"of its section, such as [{owner}]"
            )
        elif name not in sections:
            flaws.append(f"unknown section [{name}]{_did_you_mean(name, sections)}")
        else:
            sections[name] = _section(sections[name], name, table, flaws)
    if not flaws:
        try:
            return Config(**sections)
        except ConfigError as error:
            flaws.append(str(error))
    raise ConfigError("\n".join(f"{where}: {flaw}" for flaw in flaws))


def _section(base: Any, name: str, table: Mapping[str, Any], flaws: list[str]) -> Any:
    """The section with the values of the table; what is wrong with them goes to `flaws`."""
    hints = get_type_hints(type(base))
    fields = {f.name: f for f in dataclasses.fields(base)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in fields:
            flaws.append(f"unknown option '{name}.{key}'{_did_you_mean(key, fields)}")
            continue
        try:
            values[key] = checked(value, hints[key], fields[key].metadata)
        except ValueError as error:
            flaws.append(f"{name}.{key} = {toml_value(value)}: {error}")
    return dataclasses.replace(base, **values)


def _did_you_mean(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""
