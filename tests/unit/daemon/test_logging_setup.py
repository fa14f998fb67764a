# SPDX-License-Identifier: MIT
"""The form of the daemon's log."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import ins_robot
from ins_robot.config import load
from ins_robot.daemon import logging_setup


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    root = logging.getLogger()
    level, handlers = root.level, list(root.handlers)
    yield
    root.setLevel(level)
    root.handlers[:] = handlers
    logging.captureWarnings(capture=False)


def test_a_record_is_one_line_with_time_level_and_short_name() -> None:
    stream = io.StringIO()
    logging_setup.set_up("info", stream, {})
    log = logging.getLogger("ins_robot.daemon.health")
    log.info("rate %.1f Hz", 49.96)
    log.debug("not shown")
    log.warning("two\nlines")
    first, second = stream.getvalue().splitlines()
    assert re.fullmatch(r"\d{4}-\S+ \S+ INFO    daemon\.health: rate 50\.0 Hz", first)
    assert second.endswith("WARNING daemon.health: two | lines")


def test_in_the_journal_the_priority_goes_first_and_the_time_is_left_out() -> None:
    stream = io.StringIO()
    logging_setup.set_up("debug", stream, {"JOURNAL_STREAM": "8:12345"})
    log = logging.getLogger("ins_robot.x")
    for level in (
        logging.DEBUG,
        logging.INFO,
        logging.WARNING,
        logging.ERROR,
        logging.CRITICAL,
    ):
        log.log(level, "m")
    assert stream.getvalue().splitlines() == [f"<{n}>x: m" for n in (7, 6, 4, 3, 2)]


def test_setting_up_again_replaces_the_first() -> None:
    first, second = io.StringIO(), io.StringIO()
    logging_setup.set_up("info", first, {})
    logging_setup.set_up("error", second, {})
    log = logging.getLogger("ins_robot.x")
    log.warning("no")
    log.error("yes")
    assert first.getvalue() == ""
    assert second.getvalue().count("\n") == 1


def test_the_banner_tells_version_every_option_and_what_was_changed() -> None:
    stream = io.StringIO()
    logging_setup.set_up("info", stream, {})
    config = load(None, ["lrf.rpm=250", "slam.particles=60"])
    logging_setup.banner(logging.getLogger("ins_robot.x"), config, Path("/etc/c.toml"))
    text = stream.getvalue()
    assert f"ins-robot {ins_robot.__version__}, Python 3." in text
    assert "configuration: /etc/c.toml" in text
    assert "other than the defaults: lrf.rpm, slam.particles" in text
    assert re.search(r"\[lrf\] .*rpm = 250\.0", text)
    assert re.search(r"\[wheels\] .*pulses_per_rev = 1024", text)
