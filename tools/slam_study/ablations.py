# SPDX-License-Identifier: MIT
"""Estimators by name, whole or with a part taken out, to see what the part is worth.

`NAME` is one of `slam.estimator` or of `TAKEN_OUT`; `NAME+section.key=value+...` changes
options on top, e.g. `particle+slam.particles=2`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from ins_robot.config import Config, load
from ins_robot.errors import ConfigError
from ins_robot.estimation.estimators import ESTIMATORS
from ins_robot.estimation.particle_estimator import ParticleEstimator

IS_DRAWN = ("particle", "fastslam", "auto", "no-loops")
"""Those that a seed changes; the others are run once."""


class WithoutLoops(ParticleEstimator):
    """Matching and particles, but the map's past is never corrected."""

    closes_loops: ClassVar[bool] = False


TAKEN_OUT = {"no-loops": WithoutLoops}


def configured(label: str, seed: int) -> Config:
    """The configuration of an estimator's label.

    Raises
    ------
    ConfigError
        When there is no such estimator or option.
    """
    name, *options = label.split("+")
    config = load(None, [*options, f"slam.seed={seed}"])
    ESTIMATORS.update(TAKEN_OUT)
    if name not in ESTIMATORS:
        raise ConfigError(f"estimator '{name}': must be one of {', '.join(ESTIMATORS)}")
    # not an option of the robot, so it does not pass `load`
    return replace(config, slam=replace(config.slam, estimator=name))


def is_drawn(label: str) -> bool:
    return label.split("+")[0] in IS_DRAWN
