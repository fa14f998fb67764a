# SPDX-License-Identifier: MIT
"""Laws of the journal: what went in comes out, and damage costs what it hit."""

import dataclasses
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.errors import InputError, StateError
from ins_robot.logs.journal import JournalHeader, JournalWriter, is_journal, read_journal
from ins_robot.logs.journal_codec import decode_message, encode_message, find_record
from ins_robot.messages import ImuSample, LaserScan, Mark, WheelSample

HEADER = JournalHeader(
    package_version="0.1.0",
    run_name="0007-attic",
    clock="virtual",
    config_toml="[lrf]\nrpm = 250",
)


def bits(value):
    """Something that is equal only for the same bits, NaN included."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple):
        return tuple(bits(item) for item in value)
    return value


def content(message):
    fields = dataclasses.fields(message)
    return type(message), [bits(getattr(message, f.name)) for f in fields]


def scan(beams, rng, stamp_s=1.0):
    ranges_m = np.where(rng.random(beams) < 0.5, np.nan, rng.integers(100, 6000, beams) * 1e-3)
    return LaserScan(
        stamp_s=stamp_s,
        bearings_rad=np.linspace(0.0, 2 * math.pi, beams, endpoint=False),
        ranges_m=ranges_m,
        range_std_m=ranges_m**2 * 0.00083,
        beam_offsets_s=np.arange(beams) * 0.3 / max(beams, 1),
        range_max_m=6.0,
        rpm=199.7,
        valid_counts=np.isfinite(ranges_m).astype(np.int64),
    )


def conversation():
    rng = np.random.default_rng(5)
    return [
        Mark(stamp_s=0.0, kind="start", payload={"name": "attic", "n": [1, 2.5, None]}),
        ImuSample(stamp_s=0.02, yaw_rate_radps=-0.1, field_gauss=(0.2, -0.1, 0.4)),
        WheelSample(stamp_s=0.025, device_s=9.0, counts=(-5, 2**40, 0), fault="e-stop"),
        scan(16, rng),
        ImuSample(stamp_s=0.04, yaw_rate_radps=0.1 + 0.2, temperature_c=31.25),
        Mark(stamp_s=0.05, kind="stop"),
    ]


@pytest.fixture
def journal(tmp_path):
    path = tmp_path / "run.journal"
    with JournalWriter(path, HEADER) as writer:
        for message in conversation():
            writer.write(message)
    return path


floats = st.floats(width=64)
imu_samples = st.builds(
    ImuSample,
    stamp_s=floats,
    yaw_rate_radps=floats,
    field_gauss=st.none() | st.tuples(floats, floats, floats),
    temperature_c=floats,
)
counts = st.integers(-(2**63), 2**63 - 1)
wheel_samples = st.builds(
    WheelSample,
    stamp_s=floats,
    device_s=floats,
    counts=st.tuples(counts, counts, counts),
    bumper=st.booleans(),
    cliff=st.booleans(),
    emergency_stop=st.booleans(),
    fault=st.text(max_size=20),
    battery_v=floats,
)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text() | st.floats(allow_nan=False),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
marks = st.builds(
    Mark, stamp_s=floats, kind=st.text(), payload=st.dictionaries(st.text(), json_values)
)


@st.composite
def scans(draw):
    beams = draw(st.integers(0, 12))
    rows = [np.array(draw(st.lists(floats, min_size=beams, max_size=beams))) for _ in range(4)]
    counted = draw(st.sampled_from([0, beams]))
    return LaserScan(
        stamp_s=draw(floats),
        bearings_rad=rows[0],
        ranges_m=rows[1],
        range_std_m=rows[2],
        beam_offsets_s=rows[3],
        range_max_m=draw(floats),
        rpm=draw(floats),
        valid_counts=np.arange(counted, dtype=np.int64),
        is_free_when_silent=draw(st.booleans()),
    )


@settings(max_examples=80, deadline=None)
@given(imu_samples | wheel_samples | marks | scans())
def test_every_message_comes_back_bit_by_bit(message):
    record = find_record(encode_message(message), 0)
    assert record is not None
    payload = encode_message(message)[record.start : record.stop]
    assert content(decode_message(record.kind, payload)) == content(message)


@pytest.mark.parametrize("beams", [0, 1, 360, 720])
def test_large_scans_come_back_and_are_small(beams):
    message = scan(beams, np.random.default_rng(beams))
    data = encode_message(message)
    record = find_record(data, 0)
    assert content(decode_message(record.kind, data[record.start : record.stop])) == content(
        message
    )
    assert len(data) <= 40 * beams + 50


def test_a_journal_gives_header_and_messages_in_order(journal):
    header, messages = read_journal(journal)
    assert header == HEADER
    assert [content(m) for m in messages] == [content(m) for m in conversation()]
    assert messages.losses == []
    assert messages.progress == 1.0
    assert is_journal(journal)


def test_writing_is_independent_of_when_it_was_flushed(tmp_path, journal):
    other = tmp_path / "other"
    with JournalWriter(other, HEADER) as writer:
        for message in conversation():
            writer.write(message)
            writer.flush()
    assert other.read_bytes() == journal.read_bytes()


def test_what_was_flushed_survives_a_crash(tmp_path):
    path = tmp_path / "run.journal"
    writer = JournalWriter(path, HEADER)
    first, *rest = conversation()
    writer.write(first)
    writer.flush()
    for message in rest:
        writer.write(message)  # never flushed: the power went
    _, messages = read_journal(path)
    assert [content(m) for m in messages] == [content(first)]
    writer.close()
    writer.close()
    with pytest.raises(StateError, match="closed"):
        writer.write(first)


def test_a_mark_is_recorded_as_it_was_when_written(tmp_path):
    payload = {"n": 1}
    with JournalWriter(tmp_path / "j", HEADER) as writer:
        writer.write(Mark(stamp_s=0.0, kind="start", payload=payload))
        payload["n"] = 2
    _, messages = read_journal(tmp_path / "j")
    assert next(messages).payload == {"n": 1}


def record_ends(data, start):
    ends = [start]
    while (record := find_record(data, ends[-1])) is not None:
        ends.append(record.end)
    return ends


def test_a_cut_at_any_byte_loses_the_cut_record_only(journal, tmp_path):
    data = journal.read_bytes()
    expected = [content(m) for m in conversation()]
    header_end = find_record(data, 8).end
    ends = record_ends(data, header_end)
    assert ends[-1] == len(data)
    cut = tmp_path / "cut"
    for size in range(len(data)):
        cut.write_bytes(data[:size])
        if size < header_end:
            with pytest.raises(InputError):
                read_journal(cut)
            continue
        _, messages = read_journal(cut)
        whole = sum(end <= size for end in ends[1:])
        assert [content(m) for m in messages] == expected[:whole]
        lost = size - ends[whole]
        assert [(x.offset, x.length, x.is_tail) for x in messages.losses] == (
            [(ends[whole], lost, True)] if lost else []
        )


def test_a_flipped_bit_anywhere_costs_its_record_only(journal, tmp_path):
    data = journal.read_bytes()
    expected = [content(m) for m in conversation()]
    header_end = find_record(data, 8).end
    ends = record_ends(data, header_end)
    rng = np.random.default_rng(11)
    damaged = tmp_path / "damaged"
    for position in range(header_end, len(data)):
        flipped = bytearray(data)
        flipped[position] ^= 1 << int(rng.integers(8))
        damaged.write_bytes(flipped)
        _, messages = read_journal(damaged)
        hit = sum(end <= position for end in ends[1:])
        assert [content(m) for m in messages] == expected[:hit] + expected[hit + 1 :]
        assert [(x.offset, x.length) for x in messages.losses] == [
            (ends[hit], ends[hit + 1] - ends[hit])
        ]


def test_a_tail_of_zeros_is_a_loss_not_an_error(journal):
    with journal.open("ab") as file:
        file.write(bytes(5000))
    _, messages = read_journal(journal)
    assert len(list(messages)) == len(conversation())
    assert str(messages.losses[0]).startswith("5000 bytes lost")


@pytest.mark.parametrize("data", [b"", b"INS-", b"# a text file\n", b"INS-JRNL" + bytes(99)])
def test_what_is_no_journal_is_refused_in_one_line(tmp_path, data):
    path = tmp_path / "x"
    path.write_bytes(data)
    with pytest.raises(InputError, match=str(path)) as caught:
        read_journal(path)
    assert "\n" not in str(caught.value)


def test_another_format_names_the_version_that_reads_it(tmp_path):
    path = tmp_path / "x"
    JournalWriter(path, dataclasses.replace(HEADER, format_version=9)).close()
    with pytest.raises(InputError, match=r"format 9.*0\.1\.0"):
        read_journal(path)


def test_a_missing_journal_says_so(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_journal(Path(tmp_path / "nothing"))
