# SPDX-License-Identifier: MIT
"""The kind of a log is told by its content, whatever its name."""

import pytest

from ins_robot.errors import InputError
from ins_robot.logs.journal import JOURNAL_NAME, JournalHeader, JournalWriter
from ins_robot.logs.open_log import LogKind, find_log, read_log

HEADER = JournalHeader(package_version="0", run_name="r", clock="virtual", config_toml="")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("# a comment\n\nPARAM x 1\n", LogKind.CARMEN),
        ("FLASER 180 " + "1.0 " * 20_000, LogKind.CARMEN),
        ('"gyro_yaw","1504645341760565439","0.1"\n', LogKind.BOTVAC),
    ],
)
def test_files_are_known_by_their_first_lines(tmp_path, text, kind):
    path = tmp_path / "what.ever"
    path.write_text(text)
    assert find_log(path) == (kind, path)


def test_a_journal_is_found_itself_and_in_its_run_directory(tmp_path):
    path = tmp_path / JOURNAL_NAME
    JournalWriter(path, HEADER).close()
    assert find_log(path) == (LogKind.JOURNAL, path)
    assert find_log(tmp_path) == (LogKind.JOURNAL, path)
    with pytest.raises(InputError, match="read_journal"):
        read_log(LogKind.JOURNAL, path)


def test_a_directory_with_lego_files_is_one_log(tmp_path):
    (tmp_path / "a.txt").write_text("S 315 2 189 186\n")
    assert find_log(tmp_path) == (LogKind.LEGO, tmp_path)
    with pytest.raises(InputError, match="give its directory"):
        find_log(tmp_path / "a.txt")


@pytest.mark.parametrize(
    "data", [b"hello\nworld\n", b"\x00\xff" * 500, b"P5\n1 1\n255\n0", b'"a,b']
)
def test_what_is_unknown_is_refused_with_what_is_known(tmp_path, data):
    path = tmp_path / "x.clf"
    path.write_bytes(data)
    with pytest.raises(InputError, match="a CARMEN log, a Botvac"):
        find_log(path)


def test_what_is_not_there_or_empty_is_said_so(tmp_path):
    with pytest.raises(InputError, match="no such log"):
        find_log(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"without run\.journal"):
        find_log(tmp_path)
    (tmp_path / "empty").write_bytes(b"")
    with pytest.raises(InputError, match="is empty"):
        find_log(tmp_path / "empty")
