# SPDX-License-Identifier: MIT
"""Whatever is in a file: it is read, or refused in one line; never a traceback."""

import numpy as np
import pytest

from ins_robot.errors import InputError
from ins_robot.logs.journal import JournalHeader, JournalWriter, read_journal
from ins_robot.logs.open_log import LogKind, find_log, read_log
from ins_robot.logs.run_directory import read_tum
from ins_robot.mapping.map_files import read_description, read_map
from ins_robot.messages import ImuSample, Mark

STAMP = 1_504_645_341_000_000_000
CARMEN = (
    b"# log\nPARAM a b\nFLASER 3 1.0 2.0 81.83 0 0 0 0 0 0 5.5 x 5.5\n"
    b"ODOM 1 2 3 0 0 0 6.5 x 6.5\n"
)
BOTVAC = b"".join(
    b'"gyro_yaw","%d","0.1"\n"dist","%d","1.0","1.5"\n"scan","%d"%s\n'
    % (STAMP + i, STAMP + i, STAMP + i, b',"1.5"' * 360)
    for i in (10**8, 2 * 10**8)
)
LEGO = b"S 5 3 1000 1001 1002\nM 0 1 0 0 0 1 0\nM 9 2 0 0 0 5 0\nP 1 2 3\n"
SPLICES = (
    b"",
    b"\n",
    b"\r",
    b"\x00",
    b'"',
    b" ",
    b"nan",
    b"1e999",
    b"-",
    b"9" * 5000,
    b"\xff",
    b"_",
)


def damaged(data, rng):
    """Cut, overwrite, splice, or repeat a piece."""
    at = int(rng.integers(len(data)))
    match int(rng.integers(4)):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]
        case 2:
            return data[:at] + SPLICES[int(rng.integers(len(SPLICES)))] + data[at:]
        case _:
            return data[:at] + data[max(0, at - 30) :]


def check(read):
    said = ""
    try:
        read()
    except InputError as error:
        said = str(error)
    assert "\n" not in said


@pytest.mark.parametrize("original", [CARMEN, BOTVAC, LEGO], ids=["carmen", "botvac", "lego"])
def test_damaged_text_logs_are_read_or_refused(tmp_path, original):
    rng = np.random.default_rng(len(original))
    path = tmp_path / "log.txt"
    for _ in range(300):
        data = original
        for _ in range(int(rng.integers(1, 4))):
            data = damaged(data, rng) or b" "
        path.write_bytes(data)

        def read():
            kind, found = find_log(tmp_path if original is LEGO else path)
            if kind is not LogKind.JOURNAL:
                read_log(kind, found)

        check(read)


def test_damaged_journals_are_read_or_refused(tmp_path):
    path = tmp_path / "run.journal"
    header = JournalHeader(package_version="0", run_name="r", clock="virtual", config_toml="")
    with JournalWriter(path, header) as writer:
        for i in range(20):
            writer.write(ImuSample(stamp_s=float(i), yaw_rate_radps=0.5))
            writer.write(Mark(stamp_s=float(i), kind="note", payload={"i": i}))
    original = path.read_bytes()
    rng = np.random.default_rng(2)
    for _ in range(300):
        path.write_bytes(damaged(original, rng))
        check(lambda: list(read_journal(path)[1]))


def test_damaged_maps_and_trajectories_are_read_or_refused(tmp_path):
    rng = np.random.default_rng(4)
    yaml = b"image: a.pgm\nresolution: 0.05\norigin: [1.0, 2.0, 0.0]\nnegate: 0\n"
    pgm = b"P5\n# c\n3 2\n255\n" + bytes(6)
    tum = b"1.0 1 2 0 0 0 0 1\n2.0 1 2 0 0 0 0 1\n"
    path = tmp_path / "t.tum"
    for _ in range(300):
        wrong_yaml = damaged(yaml, rng).decode("utf-8", errors="replace")
        check(lambda text=wrong_yaml: read_description(text, "y"))
        wrong_pgm = damaged(pgm, rng)
        check(lambda data=wrong_pgm: read_map(data, yaml.decode(), "m"))
        path.write_bytes(damaged(tum, rng))
        check(lambda: read_tum(path))
