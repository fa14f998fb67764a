# SPDX-License-Identifier: MIT
"""The command line itself: help, errors, exit codes."""

from __future__ import annotations

import argparse
import importlib
import math
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

import ins_robot
from ins_robot.cli.commands.daemon import tell_left
from ins_robot.cli.commands.simulate import describe, parse_fault, parse_start
from ins_robot.cli.main import COMMANDS, main, with_values
from ins_robot.errors import DeviceError, InputError, RobotError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.body_faults import BodyFault

ISSUE_COMMANDS = {
    "daemon", "start", "stop", "pause", "resume", "estop", "clear", "status", "map", "next",
    "here", "scan", "goto", "zones", "runs", "check-config", "simulate", "replay",
    "localize", "emulate",
}  # fmt: skip


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], int]], None]:
    """Puts a function in the place of `simulate`."""

    def install(run: Callable[[], int]) -> None:
        module = types.ModuleType("simulate")
        module.add_arguments = lambda parser: None  # type: ignore[attr-defined]
        module.run = lambda args: run()  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "ins_robot.cli.commands.simulate", module)

    return install


def raising(error: BaseException) -> Callable[[], int]:
    def run() -> int:
        raise error

    return run


def test_help_lists_every_command_on_one_line_and_imports_none() -> None:
    script = (
        "import sys\n"
        "from ins_robot.cli.main import main\n"
        "try: main(['--help'])\n"
        "except SystemExit as end: assert end.code == 0\n"
        "found = [m for m in sys.modules if m.startswith('ins_robot.cli.commands')]\n"
        "assert not found, found\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert {command.name for command in COMMANDS} == ISSUE_COMMANDS
    for entry in COMMANDS:
        assert any(
            line.split() == [entry.name, *entry.summary.split()]
            for line in result.stdout.splitlines()
        )


@pytest.mark.parametrize(
    "words", ["zones add", "zones list", "zones remove", "runs delete", "runs list"]
)
def test_help_of_an_action_says_what_it_does(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*words.split(), "--help"])
    paragraphs = capsys.readouterr().out.split("\n\n")
    assert paragraphs[1].rstrip().endswith(".")


def test_help_lists_the_commands_once(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert "positional arguments" not in out
    assert "==SUPPRESS==" not in out


def test_every_module_of_a_client_command_keeps_the_contract() -> None:
    for entry in COMMANDS:
        if entry.name in ("daemon", "simulate", "emulate", "replay"):
            continue  # heavy ones: their own tests run them
        module = importlib.import_module(f"ins_robot.cli.commands.{entry.module}")
        module.add_arguments(argparse.ArgumentParser())
        assert callable(module.run)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"ins-robot {ins_robot.__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [["fly"], ["--fast"], ["status", "--jason"], ["runs", "delete"], ["stop", "now"]],
)
def test_wrong_usage_is_exit_code_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ["simulate", "--out", "x", "--max-radius-m=3"],
            "exploration.max_radius_m is an option of the configuration, "
            "here with --set exploration.max_radius_m=VALUE\n",
        ),
        (
            ["start", "--strategy", "x"],
            "exploration.strategy is an option of the configuration\n",
        ),
        (["status", "--jason"], "unrecognized arguments: --jason\n"),
    ],
)
def test_an_option_of_the_configuration_is_known_as_one(
    arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert capsys.readouterr().err.endswith(told)


def test_no_command_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "simulate" in err


def test_a_known_error_is_one_line_whatever_its_text(
    command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str]
) -> None:
    command(raising(RobotError("first\nsecond")))
    assert main(["simulate"]) == 1
    assert capsys.readouterr().err == "ins-robot: first second\n"
    command(raising(DeviceError("lrf: gone")))  # an OSError too, and still known
    assert main(["simulate"]) == 1
    assert capsys.readouterr().err == "ins-robot: lrf: gone\n"


def test_a_file_the_system_refuses_is_one_line(
    command: Callable[[Callable[[], int]], None], capsys: pytest.CaptureFixture[str]
) -> None:
    command(raising(OSError(28, "No space left on device", "/x/map.png")))
    assert main(["simulate"]) == 1
    assert capsys.readouterr().err == "ins-robot: /x/map.png: No space left on device\n"


@pytest.mark.parametrize("bug", [ZeroDivisionError("x"), OSError(9, "Bad file descriptor")])
def test_a_bug_keeps_its_traceback(
    command: Callable[[Callable[[], int]], None], bug: Exception
) -> None:
    command(raising(bug))
    with pytest.raises(type(bug)):
        main(["simulate"])


def test_interrupt_is_exit_code_130(command: Callable[[Callable[[], int]], None]) -> None:
    command(raising(KeyboardInterrupt()))
    assert main(["simulate"]) == 130


def test_a_reader_that_leaves_is_no_error() -> None:
    """`check-config --reference | head -c 1`: no traceback, no words."""
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_PRINTER], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.read(1)
    process.stdout.close()
    assert process.wait(30) == 141
    assert process.stderr.read() == b""
    process.stderr.close()


SLOW_PRINTER = """
import sys, types
from ins_robot.cli.main import main
module = types.ModuleType("simulate")
module.add_arguments = lambda parser: None
def run(args):
    while True:
        print("x" * 10000)
module.run = run
sys.modules["ins_robot.cli.commands.simulate"] = module
sys.exit(main(["simulate"]))
"""


def test_a_value_may_begin_with_a_minus() -> None:
    words = ["simulate", "rooms", "--start", "-1.5,2", "--json", "--seed", "-1", "-o", "-x"]
    joined = ["simulate", "rooms", "--start=-1.5,2", "--json", "--seed=-1", "-o", "-x"]
    assert with_values(words) == joined


@pytest.mark.parametrize("command", ["simulate", "emulate"])
@pytest.mark.parametrize(
    ("words", "start"),
    [
        (["--start", "-1,2"], Pose2(-1.0, 2.0, 0.0)),
        (["--start=-1,2"], Pose2(-1.0, 2.0, 0.0)),
        (["--start", "-.5,-2,-90"], Pose2(-0.5, -2.0, -math.pi / 2.0)),
    ],
)
def test_a_start_may_lie_below_zero(
    command: str, words: list[str], start: Pose2, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    module = importlib.import_module(f"ins_robot.cli.commands.{command}")
    monkeypatch.setattr(module, "run", lambda args: seen.append(args.start) or 0)
    out = {"simulate": "--out", "emulate": "--config-out"}[command]
    assert main([command, "rooms", out, "somewhere", *words]) == 0
    assert [parse_start(text) for text in seen] == [start]


def test_faults_of_the_simulated_body_come_by_name_and_time() -> None:
    assert parse_fault(["slip_burst", "30", "1.5"]) == (BodyFault.SLIP_BURST, 30.0, 1.5)
    with pytest.raises(InputError, match="--fault hail: no such fault; there are") as refused:
        parse_fault(["hail", "30", "1"])
    assert all(name in str(refused.value) for name in BodyFault)
    for times in (
        ("-1", "1"),
        ("1", "-1"),
        ("nan", "1"),
        ("1", "nan"),
        ("1", "inf"),
        ("", "1"),
    ):
        with pytest.raises(InputError, match="in seconds, 0 or more"):
            parse_fault(["stuck", *times])


SUMMARY = {
    "state": "complete",
    "reason": "all seen",
    "scans": 1,
    "path_length_m": 0.0,
    "duration_s": 9.0,
    "wall_time_s": 1.0,
}
LEFT = [{"state": "no_go"}]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"left": LEFT}, "1 place left unseen (1 no go), see summary.json `left`"),
        ({"left": None}, "1 scan, 0.0 m, 9 s of robot time in 1.0 s"),
        ({"scans": 0}, "map: d/map.png (blank: the run ended before its first scan)"),
    ],
)
def test_a_simulated_run_ends_with_what_a_person_must_know(
    changes: dict[str, object], says: str
) -> None:
    lines = describe(SUMMARY | changes, Path("d")).splitlines()
    assert says in lines
    assert any("unseen" in line for line in lines) == bool(changes.get("left"))


def test_the_daemon_logs_what_a_run_left_unseen(caplog: pytest.LogCaptureFixture) -> None:
    result = types.SimpleNamespace(name="0001-lab", notes={"left": LEFT})
    assert tell_left(result) is result
    assert "0001-lab: 1 place left unseen (1 no go)" in caplog.text


def test_a_mistyped_command_is_told_its_neighbour(capsys):
    with pytest.raises(SystemExit):
        main(["strat"])
    assert "did you mean `ins-robot start`?" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["quetzal"])
    assert capsys.readouterr().err == (
        "ins-robot: no command 'quetzal': `ins-robot --help` lists them\n"
    )


@pytest.mark.parametrize("words", [["--every", "x"], ["--every", "0"], ["--fov", "wide"]])
def test_a_number_that_is_none_is_told_what_it_must_be(words, capsys):
    with pytest.raises(SystemExit):
        main(["replay", "log", "--out", "d", *words])
    assert f"argument {words[0]}: '{words[1]}': must be" in capsys.readouterr().err
