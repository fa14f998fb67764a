# SPDX-License-Identifier: MIT
"""Laws of the motor microcontroller's framing, and what docs/protocols.md says of it."""

from __future__ import annotations

import binascii
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ins_robot.firmware import motor_mcu as mcu


@st.composite
def frames(draw: st.DrawFn) -> tuple[int, int, bytes]:
    kind = draw(st.sampled_from(sorted(mcu.PAYLOAD_BYTES)))
    size = mcu.PAYLOAD_BYTES[kind]
    # Zeros are what COBS is about: make them common.
    payload = draw(
        st.lists(st.sampled_from([0, 0, 1, 0x7F, 0xFF]), min_size=size, max_size=size)
    )
    return kind, draw(st.integers(0, 255)), bytes(payload)


def read_by_the_document(line: bytes) -> list[tuple[int, int, bytes]]:
    """A reader written from docs/protocols.md alone, slow and literal."""
    found = []
    for text in line.split(b"\0"):
        body, rest = b"", text
        while rest:
            run, rest = rest[1 : rest[0]], rest[rest[0] :]
            body += run + (b"\0" if rest else b"")
        if body:
            (crc,) = struct.unpack("<H", body[-2:])
            assert crc == binascii.crc_hqx(body[:-2], 0xFFFF)
            found.append((body[0], body[1], body[2:-2]))
    return found


@given(st.binary(max_size=80))
def test_crc_is_ccitt_false(data: bytes) -> None:
    assert mcu.crc16(data) == binascii.crc_hqx(data, 0xFFFF)


def test_crc_check_value() -> None:
    assert mcu.crc16(b"123456789") == 0x29B1


def test_golden_frame_of_the_document() -> None:
    """REARM of fault 5 with seq 0: its zero is stuffed, its CRC is 0x40F9."""
    line = bytes.fromhex("00 02 04 04 05 f9 40 00")
    assert mcu.encode_frame(mcu.REARM, 0, b"\x05") == line
    assert mcu.FrameDecoder().feed(line) == [(mcu.REARM, 0, b"\x05")]


@given(st.lists(frames(), max_size=6))
def test_round_trip_whole_bytewise_and_by_the_document(
    sent: list[tuple[int, int, bytes]],
) -> None:
    line = b"".join(mcu.encode_frame(*frame) for frame in sent)
    assert mcu.FrameDecoder().feed(line) == sent
    bytewise = mcu.FrameDecoder()
    assert [f for byte in line for f in bytewise.feed(bytes([byte]))] == sent
    assert bytewise.rejected == 0
    assert read_by_the_document(line) == sent


@given(frames(), st.binary(max_size=300), st.binary(max_size=300))
def test_noise_around_a_frame_does_not_cost_the_frame(
    frame: tuple[int, int, bytes], before: bytes, after: bytes
) -> None:
    found = mcu.FrameDecoder().feed(before + mcu.encode_frame(*frame) + after)
    assert frame in found


@given(frames(), st.data())
def test_no_flipped_bit_goes_unseen(frame: tuple[int, int, bytes], data: st.DataObject) -> None:
    wrong = bytearray(mcu.encode_frame(*frame))
    bit = data.draw(st.integers(8, len(wrong) * 8 - 9))  # the zero bytes around carry nothing
    wrong[bit // 8] ^= 1 << bit % 8
    assert mcu.FrameDecoder().feed(bytes(wrong)) == []


@given(frames(), st.data())
def test_no_lost_byte_goes_unseen(frame: tuple[int, int, bytes], data: st.DataObject) -> None:
    line = mcu.encode_frame(*frame)
    at = data.draw(st.integers(1, len(line) - 2))
    assert mcu.FrameDecoder().feed(line[:at] + line[at + 1 :]) == []


@pytest.mark.parametrize("body", [b"\x04\x07", b"\x04\x07\x05\x05", b"\x60\x07\x05", b"\x04"])
def test_a_sound_frame_of_another_length_or_kind_is_refused(body: bytes) -> None:
    """Another protocol's CRC may well be right; its bytes are not ours to unpack."""
    text = body + struct.pack("<H", binascii.crc_hqx(body, 0xFFFF))
    assert b"\0" not in text
    decoder = mcu.FrameDecoder()
    assert decoder.feed(b"\0" + bytes([len(text) + 1]) + text + b"\0") == []
    assert decoder.rejected == 1


def test_endless_garbage_stays_bounded_and_is_counted_once() -> None:
    decoder = mcu.FrameDecoder()
    for _ in range(1000):
        assert decoder.feed(b"\x55" * 100) == []
        assert len(decoder._partial) <= mcu.ENCODED_MAX + 1
    assert decoder.feed(mcu.encode_frame(mcu.HELLO, 9, b"\x01")) == [(mcu.HELLO, 9, b"\x01")]
    assert decoder.rejected == 1


@pytest.mark.parametrize("kind", sorted(mcu.PAYLOAD_BYTES))
def test_every_frame_fits(kind: int) -> None:
    line = mcu.encode_frame(kind, 255, b"\0" * mcu.PAYLOAD_BYTES[kind])
    assert len(line) - 2 <= mcu.ENCODED_MAX
    assert mcu.FrameDecoder().feed(line)


@given(st.integers(-(2**40), 2**40), st.integers(-(2**31), 2**31 - 1))
def test_wrap32_recovers_any_step_of_32_bits(start: int, step: int) -> None:
    assert mcu.wrap32(mcu.wrap32(start + step) - mcu.wrap32(start)) == step
