# SPDX-License-Identifier: MIT
"""docs/paper.md points at code and tests that are there, row by row."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "paper.md").read_text()
PATHS = sorted(set(re.findall(r"`([\w./-]+/[\w.-]+\.(?:py|md|png|toml))(?:::(\w+))?`", TEXT)))
HEAD = "| the paper | module | test |"


def find(name: str) -> Path:
    """A path of the document: from the root, the package, or the tests."""
    places = (ROOT, ROOT / "ins_robot", ROOT / "tests", ROOT / "docs")
    found = [place / name for place in places if (place / name).is_file()]
    assert found, f"docs/paper.md names {name}, which does not exist"
    return found[0]


def rows() -> list[list[str]]:
    """Cells of the tables that go through the paper's statements."""
    found, is_inside = [], False
    for line in TEXT.splitlines():
        is_inside = line.startswith("|") and (is_inside or line.startswith(HEAD))
        if is_inside and not line.startswith((HEAD, "|---")):
            found.append([cell.strip() for cell in line.strip("|").split("|")])
    return found


@pytest.mark.parametrize(("path", "name"), PATHS, ids=lambda part: part)
def test_what_it_names_exists(path: str, name: str) -> None:
    text = find(path).read_bytes()
    if name:
        assert re.search(rf"def {name}\b".encode(), text), f"{path} has no {name}"


def test_every_row_names_a_module_and_a_test_or_says_why_not() -> None:
    assert len(rows()) > 30
    for statement, module, test, *_ in rows():
        is_left_out = module.startswith("left out")
        assert is_left_out or re.search(r"`[\w/]+\.\w+", module), statement
        assert is_left_out or "::" in test, statement


def test_it_has_every_equation_and_every_figure() -> None:
    for number in range(1, 6):
        assert re.search(rf"\beq\. {number}\b", TEXT), f"equation {number}"
    for number in range(3, 10):
        assert re.search(rf"\bfigure {number}\b", TEXT, re.IGNORECASE), f"figure {number}"
