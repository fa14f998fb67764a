# SPDX-License-Identifier: MIT
"""The configuration: `sections` declares every option, `reading` and `writing` are its TOML.

`load(path, overrides)` returns a `Config` or raises a `ConfigError` of one line;
`reference_toml()` is `config.toml`, and a test holds the two equal.
"""

from ins_robot.config.all_sections import Config
from ins_robot.config.reading import load, loads, with_overrides
from ins_robot.config.sections import (
    BaseConfig,
    ControlConfig,
    DaemonConfig,
    ExplorationConfig,
    ImuConfig,
    KalmanConfig,
    LrfConfig,
    MapConfig,
    RobotConfig,
    SlamConfig,
    WheelsConfig,
)
from ins_robot.config.simulation import SimulationConfig
from ins_robot.config.writing import reference_toml, to_toml

__all__ = [
    "BaseConfig",
    "Config",
    "ControlConfig",
    "DaemonConfig",
    "ExplorationConfig",
    "ImuConfig",
    "KalmanConfig",
    "LrfConfig",
    "MapConfig",
    "RobotConfig",
    "SimulationConfig",
    "SlamConfig",
    "WheelsConfig",
    "load",
    "loads",
    "reference_toml",
    "to_toml",
    "with_overrides",
]
