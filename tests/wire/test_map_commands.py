# SPDX-License-Identifier: MIT
"""`map` and `scan` as a user calls them: to files, pipes and terminals."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from fake_robot import MAP, FakeRobot

from ins_robot.cli.main import main


def test_scan_is_a_picture_in_a_file(robot: FakeRobot, tmp_path: Path) -> None:
    assert main(["scan", "-o", str(tmp_path / "s.png")]) == 0
    assert (tmp_path / "s.png").read_bytes() == MAP["png"]


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        (["-o", "a"], "png"),
        (["-o", "a.png"], "png"),
        (["-o", "a.PGM"], "pgm"),
        (["-o", "a.map", "--format", "png"], "png"),
        (["-o", "a", "--format", "pgm"], "pgm"),
    ],
)
def test_map_to_a_file(
    robot: FakeRobot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    wanted: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["map", *options]) == 0
    assert Path(options[1]).read_bytes() == MAP[wanted]
    assert robot.calls == [("map", wanted)]
    assert not list(tmp_path.glob(".a*"))  # nothing half-written is left


def test_a_map_s_description_names_the_image_beside_it(
    robot: FakeRobot, tmp_path: Path
) -> None:
    assert main(["map", "-o", str(tmp_path / "m1.yaml")]) == 0
    assert (tmp_path / "m1.yaml").read_bytes() == b"image: m1.pgm\n"
    assert (tmp_path / "m1.pgm").read_bytes() == MAP["pgm"]


@pytest.mark.parametrize("stem", ["m: 1", "- m", "m\\1"])
def test_a_map_s_description_quotes_a_name_that_is_not_plain(
    robot: FakeRobot, tmp_path: Path, stem: str
) -> None:
    assert main(["map", "-o", str(tmp_path / f"{stem}.yaml")]) == 0
    key, _, quoted = (tmp_path / f"{stem}.yaml").read_text().partition(": ")
    assert (key, json.loads(quoted)) == ("image", f"{stem}.pgm")  # JSON is YAML


def test_an_image_that_a_description_replaces_is_told(
    robot: FakeRobot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["map", "-o", str(tmp_path / "m1.yaml")]
    assert main(words) == 0
    assert capsys.readouterr().err == ""
    assert main(words) == 0
    assert capsys.readouterr().err == f"{tmp_path}/m1.pgm: replaces the file there\n"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("-o m2.png --format yaml", "the ending says png"),
        ("-o m1.foo", "a map ends in .png .pgm .yaml"),
    ],
)
def test_a_map_s_ending_must_fit_its_format(
    robot: FakeRobot, words: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", *words.split()]) == 1
    assert says in capsys.readouterr().err
    assert robot.calls == []


def test_map_to_a_pipe_is_the_very_bytes(robot: FakeRobot, config: Path) -> None:
    command = [sys.executable, "-m", "ins_robot", "map", "--config", str(config)]
    assert subprocess.run(command, capture_output=True, check=True).stdout == MAP["png"]


@pytest.mark.parametrize("name", ["map", "scan"])
def test_a_picture_is_not_sent_to_a_terminal(robot: FakeRobot, name: str) -> None:
    terminal, end = pty.openpty()
    command = [sys.executable, "-m", "ins_robot", name]
    result = subprocess.run(command, stdout=end, stderr=subprocess.PIPE, text=True, check=False)
    os.close(end)
    os.close(terminal)
    assert result.returncode == 1
    assert result.stderr.startswith(
        f"ins-robot: {name}: a PNG is binary and stdout is a terminal"
    )
    assert result.stderr.count("\n") == 1
    assert robot.calls == []


def test_map_to_a_pipe_is_written_into_it_and_leaves_it_there(
    robot: FakeRobot, tmp_path: Path
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert main(["map", "-o", str(pipe)]) == 0
        assert os.read(reader, 4).startswith(b"\x89PNG")
    finally:
        os.close(reader)
    assert pipe.is_fifo()


def test_a_map_that_cannot_be_written_is_one_clear_error(
    robot: FakeRobot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", "-o", str(tmp_path / "missing" / "m.png")]) == 1
    assert "m.png: cannot be written: No such file" in capsys.readouterr().err
