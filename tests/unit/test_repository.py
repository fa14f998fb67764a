# SPDX-License-Identifier: MIT
"""What the repository promises beside its code: reference, documents, unit file, versions."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from ins_robot import __version__
from ins_robot.cli.main import COMMANDS
from ins_robot.config import Config, load, reference_toml

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
SUFFIXES = {"py", "md", "toml", "sock", "png", "pgm", "yaml"}
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_the_reference_configuration_is_the_code_s() -> None:
    assert (ROOT / "config.toml").read_text() == reference_toml(), "`make config` writes it"
    assert load(ROOT / "config.toml") == Config()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documents_name_only_files_that_exist(document: Path) -> None:
    text = document.read_text()
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    named = re.findall(r"`([\w.-][\w./-]*\.(?:py|md|toml))`", prose)
    linked = [link.split("#")[0] for link in re.findall(r"\]\((?!https?:)([^)]+)\)", prose)]
    places = (ROOT, ROOT / "ins_robot", document.parent)
    missing = [
        name
        for name in [*named, *filter(None, linked)]
        if not any((place / name).exists() for place in places)
    ]
    assert not missing


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documents_name_only_options_that_exist(document: Path) -> None:
    """`section.key` in backticks is an option, when `section` is a section."""
    config = Config()
    for section, key in re.findall(r"`([a-z]+)\.([a-z_]+)(?=[`= ])", document.read_text()):
        if hasattr(config, section) and key not in SUFFIXES:
            assert hasattr(getattr(config, section), key), f"{section}.{key}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documents_name_only_commands_that_exist(document: Path) -> None:
    known = {command.name for command in COMMANDS}
    for word in re.findall(
        r"\bins-robot ([a-z][a-z-]+)\b(?! `)", _code_of(document.read_text())
    ):
        assert word in known, f"ins-robot {word}"


def _code_of(text: str) -> str:
    """What stands in backticks and in blocks."""
    blocks = re.findall(r"```(.*?)```", text, flags=re.DOTALL)
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return "\n".join(
        line
        for part in [*blocks, *re.findall(r"`([^`]+)`", prose)]
        for line in part.splitlines()
        if re.match(r"(?:[A-Z_]+=\S+ )?(?:ssh pi )?ins-robot ", line)
    )


def test_constraints_hold_names_and_versions_of_every_dependency_and_nothing_else() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = [line for line in lines if not line.startswith("#")]
    for line in pinned:
        assert re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line), line
    names = [line.partition("==")[0] for line in pinned]
    assert names == sorted(set(names))
    project = PYPROJECT["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    assert {re.split(r"[<>=;\[ ]", name)[0].lower() for name in wanted} <= set(names)


def test_version_and_changelog_agree() -> None:
    assert PYPROJECT["project"]["version"] == __version__
    assert "## [Unreleased]" in (ROOT / "CHANGELOG.md").read_text()


def unit_with_an_existing_program(directory: Path) -> Path:
    text = (ROOT / "systemd" / "ins-robot.service").read_text()
    unit = directory / "ins-robot.service"
    unit.write_text(re.sub(r"^ExecStart=.*$", "ExecStart=/bin/true", text, flags=re.MULTILINE))
    return unit


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_systemd_accepts_the_unit_without_a_word(tmp_path: Path) -> None:
    """Unknown keys give exit code 0 and words on stderr, so words are what fails."""
    unit = unit_with_an_existing_program(tmp_path)
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    unit.write_text(unit.read_text().replace("WatchdogSec=10", "WatchdogSecs=10"))
    assert (
        "WatchdogSecs"
        in subprocess.run(command, capture_output=True, text=True, check=False).stderr
    ), "the check itself must be able to fail"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_the_unit_is_confined(tmp_path: Path) -> None:
    unit = unit_with_an_existing_program(tmp_path)
    command = ["systemd-analyze", "security", "--offline=yes", "--threshold=15", str(unit)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-500:]


def test_unit_and_configuration_agree() -> None:
    unit = (ROOT / "systemd" / "ins-robot.service").read_text()
    rules = (ROOT / "systemd" / "99-ins-robot.rules").read_text()
    config = Config()
    for line in ("Type=notify", "RuntimeDirectory=ins-robot", "StateDirectory=ins-robot"):
        assert line in unit.splitlines()
    assert config.daemon.socket.startswith("/run/ins-robot/")
    assert config.daemon.runs.startswith("/var/lib/ins-robot/")
    for port in (config.lrf.port, config.wheels.port):
        assert f'SYMLINK+="{port.removeprefix("/dev/")}"' in rules


def test_any_exception_is_caught_where_the_supervisor_says_and_with_a_reason() -> None:
    catching = re.compile(r"^ *except(?: Exception\b[^:]*)?:(.*)$", re.MULTILINE)
    found = {
        str(path.relative_to(ROOT / "ins_robot")): catching.findall(path.read_text())
        for path in sorted((ROOT / "ins_robot").rglob("*.py"))
    }
    found = {path: reasons for path, reasons in found.items() if reasons}
    assert set(found) == {"daemon/supervisor.py", "simulation/virtual_clock.py"}
    assert all(reason.strip().startswith("#") for each in found.values() for reason in each)


def test_every_source_file_carries_its_licence() -> None:
    roots = [ROOT / name for name in ("ins_robot", "tests", "tools")]
    files = [path for root in roots for path in root.rglob("*.py")]
    assert files
    bare = [
        str(path.relative_to(ROOT))
        for path in files
        if not re.match(r"(#!.*\n)?# SPDX-License-Identifier: MIT\n", path.read_text())
    ]
    assert not bare
