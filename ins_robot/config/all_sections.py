# SPDX-License-Identifier: MIT
"""`Config`, all sections: refuses values that are each in bounds but contradict one another."""

from __future__ import annotations

from dataclasses import dataclass, field

from ins_robot.config.option import toml_value
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
from ins_robot.errors import ConfigError
from ins_robot.outline import Corners, flaw_of, is_inside


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """All sections."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    base: BaseConfig = field(default_factory=BaseConfig)
    wheels: WheelsConfig = field(default_factory=WheelsConfig)
    lrf: LrfConfig = field(default_factory=LrfConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    kalman: KalmanConfig = field(default_factory=KalmanConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
    map: MapConfig = field(default_factory=MapConfig)
    daemon: DaemonConfig = field(default_factory=DaemonConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)

    def __post_init__(self) -> None:
        _check_across(self)
        _check_wheels(self.wheels)
        if self.exploration.boundary is not None:
            _check_boundary(self.exploration.boundary)


def _check_across(config: Config) -> None:
    """Refuse values that are each in bounds but contradict one another."""
    lrf, wheels = config.lrf, config.wheels
    if lrf.rpm_max < lrf.rpm:
        raise ConfigError(
            f"lrf.rpm_max = {lrf.rpm_max:g}: must be at least lrf.rpm = {lrf.rpm:g}"
        )
    if not lrf.range_min_m < lrf.range_trusted_m <= lrf.range_max_m:
        raise ConfigError(
            f"lrf: range_min_m = {lrf.range_min_m:g} < range_trusted_m = "
            f"{lrf.range_trusted_m:g} <= range_max_m = {lrf.range_max_m:g} must hold"
        )
    if config.base.kind == "manual" and lrf.power != "on_demand":
        raise ConfigError(
            f'lrf.power = "{lrf.power}": must be "on_demand" with base.kind = "manual": '
            "nothing tells the motion of a carried LRF, so its scans on the way have no place"
        )
    if lrf.port == wheels.port:
        raise ConfigError(
            f'lrf.port and wheels.port are both "{lrf.port}": two devices need two lines'
        )
    if abs(config.imu.gyro_sign) != 1.0:
        raise ConfigError(f"imu.gyro_sign = {config.imu.gyro_sign:g}: must be 1.0 or -1.0")


def _check_wheels(wheels: WheelsConfig) -> None:
    """Refuse what no base on three omni wheels has."""
    for name in ("angles_deg", "signs"):
        values = getattr(wheels, name)
        if len(values) != 3:  # noqa: PLR2004 - three omni wheels is what this base is
            raise ConfigError(
                f"wheels.{name} = {list(values)}: must have three entries, one a wheel"
            )
    if any(abs(sign) != 1.0 for sign in wheels.signs):
        raise ConfigError(f"wheels.signs = {list(wheels.signs)}: each must be 1.0 or -1.0")
    if wheels.free_speed_radps < wheels.speed_max_radps:
        raise ConfigError(
            f"wheels.free_speed_radps = {wheels.free_speed_radps:g}: must be at least "
            f"wheels.speed_max_radps = {wheels.speed_max_radps:g}"
        )
    if len({angle % 360.0 for angle in wheels.angles_deg}) < 3:  # noqa: PLR2004 - one a wheel
        raise ConfigError(
            f"wheels.angles_deg = {list(wheels.angles_deg)}: two wheels stand at the same angle"
        )


def _check_boundary(boundary: Corners) -> None:
    flaw = flaw_of(boundary)
    if flaw is None and not is_inside(boundary, (0.0, 0.0)):
        flaw = "the start [0, 0] lies outside of it"
    if flaw is not None:
        raise ConfigError(f"exploration.boundary = {toml_value(boundary)}: {flaw}")
