# SPDX-License-Identifier: MIT
"""What the benchmark of the whole system hands on to its runs."""

import json
import subprocess
import sys

import benchmark_system


def test_faults_and_overrides_go_to_every_run(tmp_path, monkeypatch, capsys) -> None:
    commands = []

    def simulate(command, **_options):
        commands.append(command)
        return subprocess.CompletedProcess(command, 0, json.dumps({"state": "complete"}), "")

    monkeypatch.setattr(subprocess, "run", simulate)
    words = "--only rooms clutter --seeds 1 --jobs 1 --set lrf.rpm=250"
    faults = "--fault slip_burst 30 1 --fault compass_disturbed 20 600"
    given = [*words.split(), *faults.split(), "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["benchmark_system", *given])
    assert benchmark_system.main() == 0
    assert [command[4] for command in commands] == ["rooms", "clutter"]
    assert all(
        " ".join(command).endswith(f"--set lrf.rpm=250 {faults}") for command in commands
    )
    assert "| clutter-0 | complete |" in capsys.readouterr().out
