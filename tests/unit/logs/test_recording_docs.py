# SPDX-License-Identifier: MIT
"""The recording's chapter in docs/protocols.md says what the code does."""

from pathlib import Path

import pytest

from ins_robot.logs.journal_codec import MAGIC, RecordKind, encode_message, find_record
from ins_robot.messages import ImuSample, Mark, WheelSample

CHAPTER = (
    (Path(__file__).parents[3] / "docs" / "protocols.md")
    .read_text()
    .partition("## Recording")[2]
)


def test_the_example_is_what_is_written():
    assert encode_message(Mark(stamp_s=1.5, kind="scan_begin")).hex(" ") in CHAPTER
    assert f'"{MAGIC.decode()}"' in CHAPTER


@pytest.mark.parametrize("kind", RecordKind)
def test_every_kind_of_record_is_in_the_table(kind):
    assert f"| {int(kind)} {kind.name.lower().replace('imu', 'IMU')} |" in CHAPTER


@pytest.mark.parametrize(
    ("message", "size"),
    [
        (ImuSample(stamp_s=0.0, yaw_rate_radps=0.0), 3 * 8 + 1 + 3 * 8),
        (
            WheelSample(stamp_s=0.0, device_s=0.0, counts=(0, 0, 0), fault="stop"),
            2 * 8 + 3 * 8 + 1 + 8 + 4,
        ),
    ],
)
def test_payloads_have_the_size_of_the_fields_told(message, size):
    record = find_record(encode_message(message), 0)
    assert record.stop - record.start == size
