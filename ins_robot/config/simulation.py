# SPDX-License-Identifier: MIT
"""The options of the simulator."""

from __future__ import annotations

from dataclasses import dataclass

from ins_robot.config.option import option


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationConfig:
    """The simulated robot and its sensors; read by `simulate` and `emulate` only."""

    slip_std: float = option(
        0.02,
        "wheel slip: standard deviation as a share of speed; omni bases 0.02 to 0.05, two real "
        "two-wheeled robots about 0.02 by their turns",
        at_least=0.0,
    )
    slip_bias_std: float = option(
        0.01,
        "each wheel's constant scale error, drawn once; no recording tells",
        at_least=0.0,
    )
    motor_lag_s: float = option(0.08, "time constant of a wheel motor", above=0.0)
    gyro_noise_dps: float = option(
        0.028,
        "gyro noise per reading; Botvac at rest 0.028, MPU6050 0.033 to 0.05",
        at_least=0.0,
    )
    gyro_bias_dps: float = option(
        1.0, "standard deviation of the initial gyro bias; MPU6050 at most 20", at_least=0.0
    )
    gyro_drift_dps: float = option(
        0.006,
        "gyro bias random walk per sqrt(s); Botvac 0.004 and 0.008 from first to last rest",
        at_least=0.0,
    )
    gyro_scale_std: float = option(
        0.005,
        "scale error of the gyro, drawn once, as after calibration; Botvac against its scans "
        "0.001 +- 0.005, MPU6050 before calibration 0.03",
        at_least=0.0,
    )
    compass_noise_deg: float = option(1.0, "compass noise per reading", at_least=0.0)
    compass_disturbance: float = option(
        1.0, "strength of the metal objects around; 0 = none", at_least=0.0
    )
    range_std_floor_m: float = option(
        0.0003, "LRF noise floor; Botvac standing 0.0004, XV-11 in a box 0.0002", at_least=0.0
    )
    range_std_per_m3: float = option(
        0.0008,
        "LRF noise growth with range cubed on a middling surface; Botvac standing, 0.0008",
        at_least=0.0,
    )
    reflectivity_spread: float = option(
        1.0,
        "how unlike surfaces are: standard deviation of the logarithm of reflectivity; the "
        "losses of a Botvac need 2.2, its noise about 1",
        at_least=0.0,
        at_most=4.0,
    )
    strength_lost: float = option(
        4.0,
        "strength of return at which half of the beams are lost, a middling wall at 4.5 m; the "
        "losses of a Botvac need 12",
        above=0.0,
    )
    drop_out: float = option(
        0.01,
        "share of beams lost for no reason; XV-11 in a box 0.013",
        at_least=0.0,
        at_most=1.0,
    )
    drop_out_grazing: float = option(
        1.0, "strength of losses at grazing incidence and on dark walls", at_least=0.0
    )
    mixed_pixels: float = option(
        0.5, "share of the beams across an edge that land between", at_least=0.0, at_most=1.0
    )
    rpm_ripple: float = option(
        0.003,
        "standard deviation of the LRF's speed, share; XV-11 capture 0.0026",
        at_least=0.0,
    )
    compass_chip: str = option("hmc5883l", "which compass", choices=("hmc5883l", "qmc5883l"))
    person_mps: float = option(0.8, "manual base: how fast the person walks", above=0.0)
    person_std_m: float = option(
        0.15, "manual base: how well the person finds the place, in x and in y", at_least=0.0
    )
    person_std_deg: float = option(
        10.0, "manual base: and the heading to put the LRF down with", at_least=0.0
    )
