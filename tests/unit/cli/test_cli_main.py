# SPDX-License-Identifier: MIT
"""The command line itself: help, errors, exit codes, and which configuration is read."""

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
from ins_robot.cli.config_source import ENVIRONMENT_VARIABLE, find_config, load_config
from ins_robot.cli.main import COMMANDS, main, with_values
from ins_robot.config import Config, load, reference_toml
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


def test_which_configuration_is_read(tmp_path: Path) -> None:
    system = tmp_path / "system.toml"
    named = {ENVIRONMENT_VARIABLE: "/of/the/environment.toml"}
    assert find_config(None, {}, system) is None
    system.write_text("")
    assert find_config(None, {}, system) == system
    assert find_config(None, {ENVIRONMENT_VARIABLE: ""}, system) == system
    assert find_config(None, named, system) == Path("/of/the/environment.toml")
    assert find_config(Path("explicit.toml"), named, system) == Path("explicit.toml")


def test_overrides_come_on_top_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[lrf]\nrpm = 250.0\nrevolutions = 3\n")
    args = argparse.Namespace(config=path, overrides=["lrf.rpm=260"])
    config = load_config(args)
    assert (config.lrf.rpm, config.lrf.revolutions) == (260.0, 3)


def test_check_config(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text("[lrf]\nrpm = 250.0\n")
    bad.write_text("[lrf]\nrpm = 2500.0\n")
    assert main(["check-config", str(good)]) == 0
    assert capsys.readouterr().out == f"{good}: ok\n"
    assert main(["check-config", str(bad)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"ins-robot: {bad}: lrf.rpm = 2500.0: must be at most 349\n"
    assert main(["check-config", "--config", str(bad)]) == 1
    assert main(["check-config", str(tmp_path / "none.toml")]) == 1
    assert "none.toml: no such configuration file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("imu.gyro_sign = 0.3", "imu.gyro_sign = 0.3: must be 1.0 or -1.0"),
        ('wheels.port = ""', 'wheels.port = "": must not be empty'),
        ('imu.bus = " "', "must not be empty"),
        ('daemon.socket = ""', "must not be empty"),
        ('daemon.runs = ""', "must not be empty"),
        ("robot.radius_m = 1e9", "must be at most 2"),
        ("lrf.x_m = 500", "must be at most 2"),
        ("lrf.yaw_deg = 9999", "must be at most 360"),
        ("rpm = 250", "'rpm' stands outside of any section; an option belongs below"),
        ("rpm = 250", "such as [lrf]"),
        ('daemon.runs = "~nobody-of-that-name/runs"', "no home directory"),
    ],
)
def test_what_no_robot_can_use_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, says: str
) -> None:
    path = tmp_path / "c.toml"
    path.write_text(line + "\n")
    assert main(["check-config", str(path)]) == 1
    err = capsys.readouterr().err
    assert says in err
    assert len(err.splitlines()) == 1


def test_every_flaw_of_a_file_has_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[lrf]\nrpm = 2500.0\nyaw = 3\n[ligth]\n")
    assert main(["check-config", str(path)]) == 1
    first, second, third = capsys.readouterr().err.splitlines()
    assert first == f"ins-robot: {path}: lrf.rpm = 2500.0: must be at most 349"
    assert "unknown option 'lrf.yaw'; did you mean 'yaw_deg'?" in second
    assert "unknown section [ligth]" in third


def test_a_tilde_is_the_home_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    config = load(None, ["daemon.socket=~/s", "daemon.runs=~/runs"])
    assert (config.daemon.socket, config.daemon.runs) == (f"{tmp_path}/s", f"{tmp_path}/runs")


def test_two_configuration_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check-config", "--config", "typo.toml", str(tmp_path / "empty.toml")]) == 1
    assert "one file at a time" in capsys.readouterr().err


def test_a_bad_file_of_the_environment_is_told_with_the_variable(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "nowhere.toml")
    says = f"ins-robot: ${ENVIRONMENT_VARIABLE}: nowhere.toml: no such configuration file\n"
    for words in (["check-config"], ["status"]):
        assert main(words) == 1
        assert capsys.readouterr().err == says


@pytest.mark.parametrize("runs", ["file", "file/runs", "/proc/nope/runs"])
def test_a_daemon_without_a_place_for_runs_does_not_start(
    runs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    places = [f"daemon.runs={tmp_path / runs}", f"daemon.socket={tmp_path / 's'}"]
    assert main(["daemon", "--set", places[0], "--set", places[1]]) == 1
    assert f"ins-robot: daemon.runs = {tmp_path / runs}: " in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_printed_configurations_read_back_equal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[lrf]\nrpm = 250.0\n")
    assert main(["check-config", str(path), "--print", "--set", "slam.particles=50"]) == 0
    printed = tmp_path / "printed.toml"
    printed.write_text(capsys.readouterr().out)
    assert load(printed) == load(path, ["slam.particles=50"])
    assert main(["check-config", "--reference"]) == 0
    reference = capsys.readouterr().out
    assert reference == reference_toml()
    printed.write_text(reference)
    assert load(printed) == Config()


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
