# SPDX-License-Identifier: MIT
"""XV-11 packets: the bytes of real sensors, and what may stand between them."""

from pathlib import Path

import numpy as np
import pytest

from ins_robot.errors import WireError
from ins_robot.sensing.drivers.lrf_codec import LrfCodec, PacketBatch, encode_packets

DATA = Path(__file__).parents[4] / "shared" / "data" / "xv11"
GOOD = bytes.fromhex("fae4474aa7019f02a7015f02a7016302a8019c02ec31")
TOO_SLOW = bytes.fromhex("faa2730c5280c8035280c8035280c8035280c8032d62")
CAPTURED_PACKETS = 11_451
FIELDS = (
    "index", "rpm", "distance_mm", "strength", "is_invalid", "is_weak", "error_code",
)  # fmt: skip


def capture(name: str) -> bytes:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the capture {name} is not beside the repository (../shared/data/xv11)")
    return path.read_bytes()


def feed_all(chunks: list[bytes]) -> tuple[list[PacketBatch], LrfCodec]:
    codec = LrfCodec()
    return [codec.feed(chunk) for chunk in chunks], codec


def joined(batches: list[PacketBatch], field: str) -> np.ndarray:
    return np.concatenate([getattr(batch, field) for batch in batches])


def lines(batches: list[PacketBatch]) -> list[str]:
    return [line for batch in batches for line in batch.lines]


def test_a_real_packet() -> None:
    batch = LrfCodec().feed(GOOD)
    assert (batch.index * 4).tolist() == [272]
    assert batch.rpm.tolist() == pytest.approx([297.11], abs=0.005)
    assert batch.distance_mm.tolist() == [[423, 423, 423, 424]]
    assert batch.strength.tolist() == [[671, 607, 611, 668]]
    assert not batch.is_invalid.any()
    assert not batch.is_weak.any()
    assert not batch.error_code.any()


def test_a_real_packet_of_a_slow_rotor_has_codes_and_no_distance() -> None:
    batch = LrfCodec().feed(TOO_SLOW)
    assert (batch.index * 4).tolist() == [8]
    assert batch.rpm.tolist() == pytest.approx([49.80], abs=0.005)
    assert batch.is_invalid.all()
    assert (batch.error_code == 0x52).all()
    assert (batch.distance_mm == 0).all()
    assert (batch.strength == 968).all()


def test_the_encoder_writes_the_real_packets() -> None:
    batch = LrfCodec().feed(GOOD + TOO_SLOW)
    assert encode_packets(*(getattr(batch, field) for field in FIELDS)) == GOOD + TOO_SLOW


def test_strength_warning_keeps_the_distance() -> None:
    values = np.array([[53, 1, 16383, 0]])
    flags = np.array([[False, True, False, False]])
    data = encode_packets(
        np.array([0]), np.array([200.0]), values, values, ~flags & False, flags, values * 0
    )
    batch = LrfCodec().feed(data)
    assert batch.distance_mm.tolist() == values.tolist()
    assert batch.is_weak.tolist() == flags.tolist()


@pytest.mark.parametrize(
    "change", [{"distance_mm": 16384}, {"index": 90}, {"strength": -1}, {"rpm": 1024.0}]
)
def test_what_does_not_fit_a_packet_is_refused(change: dict[str, float]) -> None:
    batch = LrfCodec().feed(GOOD)
    fields = {field: getattr(batch, field) for field in FIELDS}
    for name, value in change.items():
        fields[name] = np.full_like(fields[name], value)
    with pytest.raises(WireError, match="XV-11 packet"):
        encode_packets(**fields)


def test_one_flipped_bit_anywhere_loses_that_packet_and_no_other() -> None:
    for bit in range(8 * len(GOOD)):
        broken = bytearray(GOOD)
        broken[bit // 8] ^= 1 << bit % 8
        batches, _ = feed_all([TOO_SLOW + bytes(broken) + TOO_SLOW])
        assert (joined(batches, "index") * 4).tolist() == [8, 8], f"bit {bit}"


def test_start_byte_inside_a_cut_packet_does_not_hide_the_next() -> None:
    cut = GOOD[:9] + b"\xfa\xa5\x01"  # looks like another packet's beginning
    batches, codec = feed_all([cut + GOOD])
    assert len(joined(batches, "index")) == 1
    assert codec.counters.checksum_failures == 2
    assert codec.counters.rejected_bytes == len(cut)


@pytest.mark.parametrize("chunk", [1, 7, 132, 10**9])
def test_the_capture_gives_every_packet_however_it_is_cut(chunk: int) -> None:
    data = capture("hand_in_box.bin")
    batches, codec = feed_all([data[i : i + chunk] for i in range(0, len(data), chunk)])
    assert codec.counters.packets == len(joined(batches, "index")) == CAPTURED_PACKETS
    assert joined(batches, "is_invalid").sum() == 2799
    assert (joined(batches, "error_code") == 0x52).sum() == 1996
    assert lines(batches)[-1] == "Runtime\tV2.4.13386"
    assert codec.counters.rejected_bytes + 22 * CAPTURED_PACKETS == len(data)


def test_the_capture_cut_at_random_with_noise_and_text_between_the_packets() -> None:
    data = capture("hand_in_box.bin")
    rng = np.random.default_rng(1)
    pieces = [data[:6]]
    texts = 0
    for at in range(6, 6 + 22 * CAPTURED_PACKETS, 22):
        dice = rng.random()
        if dice < 0.1:
            pieces.append(rng.bytes(int(rng.integers(1, 60))))
        elif dice < 0.2:
            pieces.append(b" \r\nMotor on\r\n")
            texts += 1
        pieces.append(data[at : at + 22])
    noisy = b"".join(pieces)
    cuts = np.sort(rng.integers(0, len(noisy), 3000)).tolist()
    batches, _ = feed_all([noisy[a:b] for a, b in zip([0, *cuts], [*cuts, None], strict=True)])
    clean, _ = feed_all([data])
    for field in FIELDS:
        np.testing.assert_array_equal(joined(batches, field), joined(clean, field))
    assert sum("Motor on" in line for line in lines(batches)) == texts


def test_text_inside_a_packet_costs_that_packet_and_is_read() -> None:
    stream = GOOD + GOOD[:10] + b" \r\nMotor off\r\n" + GOOD[10:] + TOO_SLOW
    batches, _ = feed_all([stream])
    assert (joined(batches, "index") * 4).tolist() == [272, 8]
    assert lines(batches) == ["Motor off"]


def test_end_of_a_real_spin_down_names_the_firmware() -> None:
    batches, _ = feed_all([capture("spin_down.bin")])
    text = lines(batches)
    assert text[0] == "OK"
    assert "Piccolo Laser Distance Scanner" in text
    assert "Runtime\tV2.4.13386" in text


@pytest.mark.parametrize("chunk", [1, 3, 5000])
def test_old_firmware_is_told_by_its_header(chunk: int) -> None:
    data = capture("firmware_v21.bin")
    batches, codec = feed_all([data[i : i + chunk] for i in range(0, len(data), chunk)])
    assert codec.counters.headers_21 == 1
    assert codec.counters.packets == len(joined(batches, "index")) == 0


def test_memory_stays_bounded_on_endless_rubbish() -> None:
    codec = LrfCodec()
    rng = np.random.default_rng(0)
    for _ in range(200):
        codec.feed(rng.bytes(500))
        codec.feed(b"A" * 500)
        assert len(codec._pending) < 22
        assert len(codec._line) <= 200


def test_reset_forgets_the_unfinished() -> None:
    codec = LrfCodec()
    codec.feed(GOOD[:12])
    codec.reset()
    assert len(codec.feed(GOOD[12:])) == 0
    assert len(codec.feed(GOOD)) == 1
