# SPDX-License-Identifier: MIT
"""Every error the project raises on purpose, as one tree.

RobotError
├── ConfigError            a config file, key or value that cannot be used (also ValueError)
├── InputError             a file given by the user that cannot be used (also ValueError)
├── DeviceError            a device is missing, another one, or misbehaves (also OSError)
├── WireError              bytes on a wire that are not a frame (also ValueError)
├── StateError             a command the present state does not allow (also RuntimeError)
└── DegenerateGeometryError  geometry without an answer (also ValueError)

The message is one line: what, where, value with unit, limit, likely cause, what to do.
The CLI prints these as that one line and exits with 1; anything else is a bug and keeps its
traceback.
"""

from __future__ import annotations


class RobotError(Exception):
    """Root of all errors raised on purpose."""


class ConfigError(RobotError, ValueError):
    """A configuration file, key or value cannot be used."""


class InputError(RobotError, ValueError):
    """A file given by the user (log, world, map) cannot be used."""


class DeviceError(RobotError, OSError):
    """A device is missing, is not the expected one, or misbehaves."""


class WireError(RobotError, ValueError):
    """Bytes on a wire are not a frame."""


class StateError(RobotError, RuntimeError):
    """The present state does not allow what was asked for."""


class DegenerateGeometryError(RobotError, ValueError):
    """The geometry has no unique answer."""
