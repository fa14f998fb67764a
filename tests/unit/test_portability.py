# SPDX-License-Identifier: MIT
"""`simulate` and `replay` need nothing that only Unix has."""

import subprocess
import sys

import pytest

HIDDEN = ["fcntl", "termios", "pty", "tty", "resource", "grp", "pwd"]


@pytest.mark.parametrize(
    "modules",
    [
        "ins_robot.cli.commands.simulate ins_robot.daemon.runtime ins_robot.simulation.harness",
        "ins_robot.cli.commands.replay ins_robot.logs.replay ins_robot.logs.replay_journal",
    ],
)
def test_it_imports_without_unix_only_modules(modules: str) -> None:
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({HIDDEN!r})); "
        f"import importlib; [importlib.import_module(m) for m in {modules.split()!r}]"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
