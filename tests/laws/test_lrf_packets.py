# SPDX-License-Identifier: MIT
"""Laws of the XV-11 codec: it inverts the encoder, whatever the stream is cut into."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ins_robot.sensing.drivers.lrf_codec import LrfCodec, encode_packets

FIELDS = (
    "index", "rpm", "distance_mm", "strength", "is_invalid", "is_weak", "error_code",
)  # fmt: skip


def random_packets(seed: int, count: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    is_invalid = rng.random((count, 4)) < 0.3
    return {
        "index": rng.integers(0, 90, count),
        "rpm": rng.integers(0, 0x10000, count) / 64.0,
        "distance_mm": rng.integers(0, 0x4000, (count, 4)) * ~is_invalid,
        "strength": rng.integers(0, 0x10000, (count, 4)),
        "is_invalid": is_invalid,
        "is_weak": (rng.random((count, 4)) < 0.3) & ~is_invalid,
        "error_code": rng.integers(0, 256, (count, 4)) * is_invalid,
    }


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    count=st.integers(0, 40),
    cuts=st.lists(st.integers(0, 880), max_size=12),
)
def test_decoding_inverts_encoding_however_it_is_cut(
    seed: int, count: int, cuts: list[int]
) -> None:
    packets = random_packets(seed, count)
    data = encode_packets(*(packets[field] for field in FIELDS))
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    codec = LrfCodec()
    batches = [codec.feed(data[a:b]) for a, b in itertools.pairwise(places)]
    for field in FIELDS:
        decoded = np.concatenate([getattr(batch, field) for batch in batches])
        np.testing.assert_array_equal(decoded, packets[field])
    assert codec.counters.rejected_bytes == 0


@settings(max_examples=60, deadline=None)
@given(noise=st.lists(st.binary(max_size=50), min_size=5, max_size=5), seed=st.integers(0, 999))
def test_noise_between_packets_costs_none(noise: list[bytes], seed: int) -> None:
    packets = random_packets(seed, 4)
    data = encode_packets(*(packets[field] for field in FIELDS))
    stream = b"".join(n + data[22 * i : 22 * i + 22] for i, n in enumerate(noise))
    batch = LrfCodec().feed(stream)
    if len(batch) == 4:  # more only if the noise is a packet itself
        np.testing.assert_array_equal(batch.index, packets["index"])
        np.testing.assert_array_equal(batch.distance_mm, packets["distance_mm"])
    else:
        assert len(batch) > 4
