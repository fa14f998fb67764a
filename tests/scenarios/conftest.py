# SPDX-License-Identifier: MIT
"""Runs of the whole daemon on the wire, each computed once per session."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


def _ins_robot(*words: object, check: bool = True) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ins_robot", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)
    if check:
        assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="session")
def ins_robot() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the command line as a user would: `ins_robot("simulate", ..., check=False)`."""
    return _ins_robot


@pytest.fixture(scope="session")
def rooms_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """`simulate rooms --seed 0`: directory and summary."""
    directory = tmp_path_factory.mktemp("rooms")
    done = _ins_robot("simulate", "rooms", "--seed", 0, "--out", directory, "--json")
    return directory, json.loads(done.stdout)
