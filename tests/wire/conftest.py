# SPDX-License-Identifier: MIT
"""A robot that answers on a control socket, and the configuration that finds it."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_robot import FakeRobot, served


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(f'[daemon]\nsocket = "{tmp_path}/s"\n')
    return path


@pytest.fixture
def robot(tmp_path: Path, config: Path, monkeypatch: pytest.MonkeyPatch) -> FakeRobot:
    robot = FakeRobot()
    monkeypatch.setenv("INS_ROBOT_CONFIG", str(config))
    with served(tmp_path / "s", robot):
        yield robot
