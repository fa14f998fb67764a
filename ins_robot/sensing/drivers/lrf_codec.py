# SPDX-License-Identifier: MIT
"""XV-11 bytes <-> packets of four readings: checksum, resync by one byte, text told apart.

`LrfCodec.feed` takes bytes as they come and returns a `PacketBatch`; `lrf_revolutions` is next.
`encode_packets` is its inverse, for the emulator. Packet layout, checksum and flags follow the
public description of the Neato XV-11 (firmware 2.4 and 2.6), see docs/protocols.md.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from ins_robot.errors import WireError
from ins_robot.geometry.angles import FloatArray

PACKET_BYTES = 22
PACKETS_PER_TURN = 90
BEAMS_PER_PACKET = 4
BEAMS_PER_TURN = PACKETS_PER_TURN * BEAMS_PER_PACKET
PACKET_LINE_TIME_S = PACKET_BYTES * 10 / 115200  # on the sensor's own UART, 8N1
DISTANCE_MAX_MM = 0x3FFF

_WORDS = PACKET_BYTES // 2
_START = 0xFA
_START_BYTE = b"\xfa"
_INDEX_FIRST = 0xA0
_INVALID, _WEAK = 0x8000, 0x4000  # flags in a reading's first word
_HEADER_21 = b"\x5a\xa5\x00\xc0"
_LINE_MAX_BYTES = 200
_FEW_PACKETS = 16  # a loop over their words is faster than numpy's fixed cost
_CHECKSUM_WEIGHTS = 2 ** np.arange(9, -1, -1, dtype=np.int64)  # one shift per word that follows
_FIELD_MAX = np.array([PACKETS_PER_TURN - 1, 0xFFFF, *[DISTANCE_MAX_MM, 0xFFFF] * 4, 0])
_AS_WORDS = struct.Struct(f"<{_WORDS}H")
_TEXT = frozenset(b"\t" + bytes(range(ord(" "), ord("~") + 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketBatch:
    """n packets in the order they came, and what was found between them.

    Attributes
    ----------
    index : (n,) int64
        Place of the packet in the turn, 0..89; its first beam is number 4 * index.
    rpm : (n,) float64
        Rotation speed the sensor reports.
    distance_mm, strength : (n, 4) int64
        Distance is 0 where the reading is invalid.
    is_invalid, is_weak : (n, 4) bool
        No distance; distance with the strength warning.
    error_code : (n, 4) int64
        Why there is no distance; 0 where there is one.
    lines : tuple of str
        Lines of text that ended in these bytes, without line ends, empty ones left out.
    """

    index: np.ndarray
    rpm: FloatArray
    distance_mm: np.ndarray
    strength: np.ndarray
    is_invalid: np.ndarray
    is_weak: np.ndarray
    error_code: np.ndarray
    lines: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of packets."""
        return len(self.index)


@dataclass(slots=True)
class CodecCounters:
    """What went over the line so far.

    `checksum_failures` counts places that looked like a packet and were none, `rejected_bytes`
    every byte outside a good packet (text included), `headers_21` the frame headers of the old
    firmware 2.1, whose format is not spoken here.
    """

    packets: int = 0
    checksum_failures: int = 0
    rejected_bytes: int = 0
    headers_21: int = 0


class LrfCodec:
    """Packets out of a byte stream, however it is cut and whatever is between them.

    At most 21 bytes of an unfinished packet and 200 of an unfinished line are kept.
    """

    def __init__(self) -> None:
        self.counters = CodecCounters()
        self._pending = b""  # starts with 0xFA, shorter than a packet
        self._line = bytearray()
        self._header_tail = b""

    def feed(self, data: bytes) -> PacketBatch:
        """Take the next bytes of the stream; return the packets and lines they completed."""
        buffer = self._pending + data if self._pending else data
        lines: list[str] = []
        runs: list[np.ndarray] = []
        at, end = 0, len(buffer)
        while at < end:
            if buffer[at] != _START:
                found = buffer.find(_START_BYTE, at)
                start = end if found < 0 else found
                self._reject(buffer[at:start], lines)
                at = start
                continue
            if end - at < PACKET_BYTES:
                if end - at == 1 or _is_index(buffer[at + 1]):
                    break
                good = _NO_WORDS
            else:
                good = _good_run(buffer, at, (end - at) // PACKET_BYTES)
            if len(good):
                runs.append(good)
                self.counters.packets += len(good)
                self._line.clear()
                at += len(good) * PACKET_BYTES
            else:
                self.counters.checksum_failures += _is_index(buffer[at + 1])
                self._reject(buffer[at : at + 1], lines)
                at += 1  # not a whole packet: 0xFA also occurs inside one
        self._pending = buffer[at:]
        if not runs:
            return _batch(_NO_WORDS, lines) if lines else _EMPTY
        return _batch(runs[0] if len(runs) == 1 else np.concatenate(runs), lines)

    def reset(self) -> None:
        """Forget unfinished packet and line: what comes next was sent much later."""
        self._reject(self._pending, [])
        self._pending = b""
        self._line.clear()

    def _reject(self, chunk: bytes, lines: list[str]) -> None:
        """Bytes that are in no packet: text, an old firmware's frame, or noise."""
        self.counters.rejected_bytes += len(chunk)
        seen = self._header_tail + chunk
        self.counters.headers_21 += seen.count(_HEADER_21)
        self._header_tail = seen[-3:]
        line = self._line
        for byte in chunk:
            if byte in _TEXT:
                if len(line) < _LINE_MAX_BYTES:
                    line.append(byte)
            else:
                if byte in b"\r\n" and (text := line.decode("ascii").strip()):
                    lines.append(text)
                line.clear()


def encode_packets(
    index: np.ndarray,
    rpm: FloatArray,
    distance_mm: np.ndarray,
    strength: np.ndarray,
    is_invalid: np.ndarray,
    is_weak: np.ndarray,
    error_code: np.ndarray,
) -> bytes:
    """The bytes of n packets, shapes as in `PacketBatch`; the sensor's half of the codec.

    Raises
    ------
    WireError
        When a value does not fit its field, or a reading is both invalid and weak (which the
        sensor never sends).
    """
    wide = np.empty((len(index), _WORDS), dtype=np.int64)
    wide[:, 0] = index
    wide[:, 1] = np.rint(rpm * 64.0)
    wide[:, 2:10:2] = np.where(is_invalid, error_code, distance_mm)
    wide[:, 3:11:2] = strength
    wide[:, 10] = 0
    fits = (wide >= 0) & (wide <= _FIELD_MAX)
    if not fits.all():
        at, word = (int(i) for i in np.argwhere(~fits)[0])
        raise WireError(
            f"XV-11 packet {at}: word {word} = {wide[at, word]}, must be within "
            f"0..{_FIELD_MAX[word]}: a bug of the sender"
        )
    if (is_invalid & is_weak).any():
        raise WireError("XV-11 packet: a reading is both invalid and weak: a bug of the sender")
    wide[:, 0] = _START + ((_INDEX_FIRST + wide[:, 0]) << 8)
    wide[:, 2:10:2] += _INVALID * is_invalid + _WEAK * is_weak
    wide[:, 10] = _checksums(wide)
    return wide.astype("<u2").tobytes()


def _checksums(words: np.ndarray) -> np.ndarray:
    """(n,) checksums of (n, 11) packets as words, over the first ten of each."""
    total = words[:, :10] @ _CHECKSUM_WEIGHTS
    checksums: np.ndarray = ((total & 0x7FFF) + (total >> 15)) & 0x7FFF
    return checksums


def _good_run(buffer: bytes, at: int, count: int) -> np.ndarray:
    """(m, 11) words of the m <= `count` good packets that follow one another from `at` on."""
    if count <= _FEW_PACKETS:
        good = 0
        while good < count and _is_packet(buffer, at + PACKET_BYTES * good):
            good += 1
        return np.frombuffer(buffer, "<u2", good * _WORDS, at).reshape(-1, _WORDS)
    words = np.frombuffer(buffer, "<u2", count * _WORDS, at).reshape(count, _WORDS)
    first = words[:, 0]
    is_good = (
        ((first & 0xFF) == _START)
        & ((first >> 8) - _INDEX_FIRST < PACKETS_PER_TURN)  # unsigned: below 0xA0 wraps far up
        & (_checksums(words) == words[:, 10])
    )
    return words if is_good.all() else words[: int(np.argmin(is_good))]


def _is_index(byte: int) -> bool:
    return 0 <= byte - _INDEX_FIRST < PACKETS_PER_TURN


def _is_packet(buffer: bytes, at: int) -> bool:
    """Whether the 22 bytes at `at` are a packet."""
    if not _is_index(buffer[at + 1]):
        return False
    *words, checksum = _AS_WORDS.unpack_from(buffer, at)
    total = 0
    for word in words:
        total = (total << 1) + word
    return bool(((total & 0x7FFF) + (total >> 15)) & 0x7FFF == checksum)


def _batch(words: np.ndarray, lines: list[str]) -> PacketBatch:
    """Packets as words -> fields."""
    wide = words.astype(np.int64)
    first = wide[:, 2:10:2]
    value = first & DISTANCE_MAX_MM
    is_invalid = first >= _INVALID
    return PacketBatch(
        index=(wide[:, 0] >> 8) - _INDEX_FIRST,
        rpm=wide[:, 1] / 64.0,
        distance_mm=value * ~is_invalid,
        strength=wide[:, 3:11:2],
        is_invalid=is_invalid,
        is_weak=first & (_INVALID | _WEAK) == _WEAK,
        error_code=(value & 0xFF) * is_invalid,
        lines=tuple(lines),
    )


_NO_WORDS = np.zeros((0, _WORDS), dtype="<u2")
_EMPTY = _batch(_NO_WORDS, [])
