# SPDX-License-Identifier: MIT
"""Every option of the robot: one frozen dataclass per section, declared once with its bounds.

A component receives its own section only; `all_sections` puts them together.
"""

from __future__ import annotations

from dataclasses import dataclass

from ins_robot.config.option import option


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotConfig:
    """The body."""

    radius_m: float = option(
        0.20, "body radius, the circle that must not touch a wall", above=0.0, at_most=2.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseConfig:
    """What carries the LRF: three driven omni wheels, or a person (the paper's emulation)."""

    kind: str = option(
        "omni3",
        "three omni wheels, gyro and compass; or no motors: a person carries the LRF",
        choices=("omni3", "manual"),
    )
    carried_std_m: float = option(
        0.3,
        "manual: how far from the named place the LRF may have been put, in x and in y",
        above=0.0,
        at_most=1.0,
    )
    carried_std_deg: float = option(
        20.0, "manual: how far from the named heading it may look", above=0.0, at_most=45.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Three omni wheels and the serial line to their microcontroller."""

    port: str = option("/dev/ins-motors", "serial device of the motor microcontroller (MCU)")
    baud: int = option(115200, "line speed; ignored by USB devices", at_least=1200)
    radius_m: float = option(0.05, "wheel radius", above=0.0, at_most=1.0)
    arm_m: float = option(
        0.15, "distance from the body centre to a wheel", above=0.0, at_most=2.0
    )
    angles_deg: tuple[float, ...] = option(
        (60.0, 180.0, 300.0),
        "polar angle of each wheel from the body's x axis, ccw",
        at_least=-360.0,
        at_most=360.0,
    )
    signs: tuple[float, ...] = option(
        (1.0, 1.0, 1.0), "+1 where positive speed drives the body ccw, -1 where wired otherwise"
    )
    pulses_per_rev: int = option(1024, "encoder pulses per wheel revolution", at_least=1)
    quadrature: int = option(4, "counts per pulse", at_least=1, at_most=4)
    speed_max_radps: float = option(8.0, "fastest a wheel may turn", above=0.0)
    free_speed_radps: float = option(
        12.0, "speed of an unloaded wheel at full duty; the MCU's feed-forward", above=0.0
    )
    dead_man_s: float = option(
        0.2,
        "the MCU stops the wheels when no set point arrives for this long",
        at_least=0.02,
        at_most=2.0,
    )
    silence_timeout_s: float = option(
        0.5, "no telemetry for this long: the MCU counts as lost", above=0.0
    )
    battery_low_v: float = option(
        10.5, "below this the run ends and the map is saved; 0 = off", at_least=0.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LrfConfig:
    """The laser range finder (LRF): Neato XV-11 behind an XV Lidar Controller."""

    port: str = option("/dev/ins-lrf", "serial device of the XV Lidar Controller")
    baud: int = option(115200, "line speed; ignored by USB devices", at_least=1200)
    power: str = option(
        "on_demand",
        "motor only while scanning (the paper), or always on, feeding SLAM on the way",
        choices=("on_demand", "continuous"),
    )
    rpm: float = option(200.0, "set speed (the paper's)", at_least=180.0, at_most=349.0)
    rpm_max: float = option(
        300.0,
        "the set speed is raised up to this when beams say 'too slow'",
        at_least=180.0,
        at_most=349.0,
    )
    rpm_step: float = option(25.0, "by how much it is raised at a time", above=0.0)
    rpm_tolerance: float = option(
        0.08,
        "a revolution whose speed is off by more (share of the set speed) is rejected",
        above=0.0,
        at_most=0.5,
    )
    revolutions: int = option(5, "revolutions combined into one scan (the paper's)", at_least=1)
    spin_up_timeout_s: float = option(
        6.0, "no steady revolution within this after motor-on is a fault", above=0.0
    )
    sector_deg: float = option(
        150.0,
        "scans after the first look this far to each side of the heading",
        above=0.0,
        at_most=180.0,
    )
    look_every_m: float = option(
        1.0,
        "on_demand: a sweep is taken on the way where no scan was taken this near: thin legs "
        "show only from near; 0 = sweeps only when the pose is uncertain",
        at_least=0.0,
    )
    range_min_m: float = option(0.10, "nearer readings are the robot itself", at_least=0.0)
    range_trusted_m: float = option(3.0, "readings up to here are taken as accurate", above=0.0)
    range_max_m: float = option(6.0, "readings beyond are not used", above=0.0, at_most=16.0)
    range_std_floor_m: float = option(
        0.003,
        "standard deviation of a near reading, with what repeating does not show: on a wall "
        "neighbours differ by 1 to 4 mm",
        above=0.0,
    )
    range_std_per_m3: float = option(
        0.0008,
        "growth of the standard deviation with the cube of range, m per m^3; fitted to a "
        "standing Botvac",
        at_least=0.0,
    )
    weak_return_factor: float = option(
        3.0, "a reading with the strength warning counts as this much noisier", at_least=1.0
    )
    x_m: float = option(0.0, "where the LRF sits on the body", at_least=-2.0, at_most=2.0)
    y_m: float = option(0.0, "where the LRF sits on the body", at_least=-2.0, at_most=2.0)
    yaw_deg: float = option(
        0.0,
        "bearing of the first beam; an XV-11 is often near -10",
        at_least=-360.0,
        at_most=360.0,
    )
    is_clockwise: bool = option(
        False, "turns clockwise seen from above (upside-down, other makes)"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuConfig:
    """Gyro (MPU6050 family) and compass (HMC5883L or QMC5883L) on I2C."""

    bus: str = option("/dev/i2c-1", "I2C bus, or unix:/path of an emulated one")
    rate_hz: float = option(50.0, "readings per second", above=0.0, at_most=200.0)
    gyro_address: int = option(0x68, "0x69 when AD0 is high", at_least=0, at_most=0x7F)
    gyro_sign: float = option(1.0, "1.0, or -1.0 when mounted upside-down")
    gyro_scale: float = option(
        1.0, "true rate / reported rate, from calibration", at_least=0.5, at_most=2.0
    )
    bias_time_s: float = option(2.0, "standstill averaged for the bias at start", above=0.0)
    bias_std_max_dps: float = option(
        0.3, "more spread than this is not a standstill", above=0.0
    )
    use_compass: bool = option(True, "false: heading from gyro and LRF alone")
    compass_yaw_deg: float = option(
        0.0, "bearing of the compass's x axis on the body", at_least=-360.0, at_most=360.0
    )
    field_tolerance: float = option(
        0.2,
        "compass refused when the field norm is off by more (share of the first)",
        above=0.0,
    )
    disagreement_deg: float = option(
        4.0, "compass refused when it turned this much other than the gyro", above=0.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class KalmanConfig:
    """The centralized Kalman filter: encoders + gyro + compass."""

    accel_std_mps2: float = option(0.5, "process noise of the velocity", above=0.0)
    yaw_accel_std_radps2: float = option(1.5, "process noise of the yaw rate", above=0.0)
    bias_drift_std_radps: float = option(
        1e-4, "gyro bias random walk per sqrt(s); Botvac 0.7e-4 and 1.4e-4", above=0.0
    )
    wheel_std_mps: float = option(0.01, "noise of each velocity from the encoders", above=0.0)
    wheel_yaw_std_radps: float = option(0.05, "noise of the yaw rate from encoders", above=0.0)
    gyro_std_radps: float = option(0.002, "noise of the gyro", above=0.0)
    compass_std_deg: float = option(15.0, "noise of an accepted compass heading", above=0.0)
    compass_spacing_m: float = option(
        1.0, "a compass errs alike this far around: one update per this distance", at_least=0.0
    )
    slip_gate_radps: float = option(
        0.15, "encoder and gyro disagreeing by more is slip", above=0.0
    )
    slip_inflation: float = option(
        10.0, "by how much slip inflates the encoder noise", at_least=1.0
    )
    odometry_std_per_m: float = option(
        0.03, "position error per sqrt(metre) driven, for the pose uncertainty", above=0.0
    )
    heading_std_per_rad: float = option(
        0.005,
        "heading error per sqrt(radian) turned; a gyro 3 % off, not calibrated: 0.02",
        above=0.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlConfig:
    """Following a path, and what limits it."""

    cruise_mps: float = option(0.2, "speed on a free path", above=0.0, at_most=2.0)
    turn_radps: float = option(1.0, "fastest turn", above=0.0, at_most=6.0)
    accel_mps2: float = option(0.4, "fastest change of speed", above=0.0)
    yaw_accel_radps2: float = option(2.0, "fastest change of turn rate", above=0.0)
    position_gain_per_s: float = option(
        2.0, "K of e' = -K e in x and y", above=0.0, at_most=10.0
    )
    heading_gain_per_s: float = option(
        2.5, "K of e' = -K e in heading", above=0.0, at_most=10.0
    )
    position_tolerance_m: float = option(0.03, "arrived", above=0.0)
    heading_tolerance_deg: float = option(2.0, "arrived", above=0.0)
    guard: bool = option(True, "the collision guard has the last word")
    guard_margin_m: float = option(
        0.02, "clearance the guard keeps around the body", at_least=0.0
    )
    guard_time_s: float = option(
        0.8, "slow down so that the nearest obstacle is at least this far in time", at_least=0.0
    )
    stuck_s: float = option(6.0, "no progress for this long: the goal is given up", above=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationConfig:
    """The INS: which gap next."""

    strategy: str = option(
        "auto",
        "the paper's: narrowest gap of the cheapest node; widest; or back along the order of "
        "traversal; the field's yardsticks; auto: most new ground for the way",
        choices=(
            "min-gap",
            "max-gap",
            "backtrack",
            "nearest-frontier",
            "explore-lite",
            "next-best-view",
            "tsp-frontier",
            "auto",
        ),
    )
    gap_range_m: float = option(4.0, "readings longer than this (or none) are a gap", above=0.0)
    gap_jump_m: float = option(
        0.5, "a range jump between beams of more than this is a gap", above=0.0
    )
    clearance_m: float = option(0.03, "kept free around the body when planning", at_least=0.0)
    neighbour_range_m: float = option(
        12.0,
        "rule A: nodes closer than this may be neighbours (twice the scan range)",
        above=0.0,
    )
    visibility_guard: bool = option(
        True,
        "a gap counts as explored by the rules only where the map has really been seen; "
        "false: the paper's rules as printed",
    )
    frontier_min_m: float = option(
        0.3,
        "with the guard: unseen edges of the map at least this long become gaps too",
        above=0.0,
    )
    boundary: tuple[tuple[float, float], ...] | None = option(
        None,
        'stay inside this polygon, [[x, y], ...] in metres, start pose = [0, 0]; or "none"',
    )
    max_radius_m: float = option(0.0, "stay this near to the start; 0 = no limit", at_least=0.0)
    return_home: bool = option(True, "a run that has ended drives back to where it began")
    max_scans: int = option(2000, "exploring ends after this many", at_least=1)
    max_time_s: float = option(
        14400.0, "a run takes at most this long, the way home included", above=0.0
    )
    max_distance_m: float = option(
        0.0, "a run drives at most this far, the way home included; 0 = no limit", at_least=0.0
    )
    battery_reserve_v: float = option(
        0.3,
        "so much above wheels.battery_low_v exploring ends: the rest is for the way home",
        at_least=0.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamConfig:
    """Pose and map correction."""

    estimator: str = option(
        "auto",
        "odometry alone; similarity transform or FastSLAM on features (the paper's 5.1, 5.2); "
        "particle filter on whole scans; auto: the best of them, today the last",
        choices=("odometry", "similarity", "fastslam", "particle", "auto"),
    )
    particles: int = option(100, "particle count", at_least=2, at_most=5000)
    resample_below: float = option(
        0.5,
        "resample when the effective sample size falls below this share",
        above=0.0,
        at_most=1.0,
    )
    bearing_std_deg: float = option(0.5, "bearing noise of a beam", above=0.0)
    node_distance_m: float = option(
        0.4, "continuous scans: a scan this far from the last node becomes a node", above=0.0
    )
    node_turn_deg: float = option(
        20.0, "continuous scans: a scan turned this far becomes a node", above=0.0
    )
    wall_directions: bool = option(
        True, "particle: most walls run along few directions, which hold the heading"
    )
    joint_alignment: bool = option(
        True, "particle: at the end of a run all scans are laid on one another at once"
    )
    sweep_std_m: float = option(
        0.06, "on_demand: pose uncertainty past which a sweep is taken on the way", above=0.0
    )
    seed: int = option(0, "seed of every random choice of the robot", at_least=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MapConfig:
    """The occupancy grid."""

    resolution_m: float = option(0.05, "cell size", above=0.005, at_most=0.5)
    hit_log_odds: float = option(0.9, "what a beam's end adds", above=0.0)
    miss_log_odds: float = option(0.4, "what a beam's way takes", above=0.0)
    log_odds_max: float = option(
        4.0, "clamp, so that doors can re-open", above=0.0, at_most=7.0
    )
    beam_max_m: float = option(
        20.0, "beams are drawn this far at most; bounds the map and its cost", above=0.0
    )
    silent_free_m: float = option(
        1.0,
        "how far the way of beams without a reading counts as free where silence is no proof: "
        "a wall passed at a body's distance falls silent no nearer than this, and never beyond "
        "a wall that was seen; 0 = never",
        at_least=0.0,
    )
    silent_wide_deg: float = option(
        40.0,
        "silence this wide beside readings is free up to lrf.range_trusted_m, before where the "
        "walls beside it would go on: a hall larger than the range; 0 = never",
        at_least=0.0,
        at_most=360.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DaemonConfig:
    """The process, its files and its socket."""

    socket: str = option(
        "/run/ins-robot/control.sock", "where the client commands find the daemon"
    )
    runs: str = option("/var/lib/ins-robot/runs", "directory of the recorded runs")
    keep_runs: int = option(20, "older runs are removed; 0 = keep all", at_least=0)
    keep_free_mb: int = option(200, "a run is not started with less disk free", at_least=0)
    log_level: str = option("info", "", choices=("debug", "info", "warning", "error"))
