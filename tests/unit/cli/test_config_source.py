# SPDX-License-Identifier: MIT
"""Which configuration a command reads, and what is said of one that cannot be used."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from ins_robot.cli.config_source import ENVIRONMENT_VARIABLE, find_config, load_config
from ins_robot.cli.main import main
from ins_robot.config import Config, load, reference_toml


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
