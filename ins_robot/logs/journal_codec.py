# SPDX-License-Identifier: MIT
"""Messages of the core as records of a run's journal, and back: bytes only, no files.

A record is `length u32 | kind u8 | payload | CRC-32 u32`, little-endian; `length` counts the
payload, the CRC covers all that precedes it. Floats are stored as their 64 bits, so that a
replay computes with exactly what the run computed with. docs/protocols.md has the tables.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from ins_robot.errors import WireError
from ins_robot.messages import ImuSample, LaserScan, Mark, WheelSample

FORMAT_VERSION = 1
MAGIC = b"INS-JRNL"
PAYLOAD_MAX = 1 << 20  # a scan of 20,000 beams; bounds the search after damage

Message = ImuSample | WheelSample | LaserScan | Mark

_PREFIX = struct.Struct("<IB")
_CRC = struct.Struct("<I")
_IMU = struct.Struct("<3dB3d")
_WHEELS = struct.Struct("<2d3qBd")
_SCAN = struct.Struct("<3dBIIB")
_STAMP = struct.Struct("<d")
OVERHEAD = _PREFIX.size + _CRC.size

_BUMPER, _CLIFF, _EMERGENCY_STOP = 1, 2, 4


class RecordKind(IntEnum):
    """What a record holds."""

    HEADER = 1
    IMU = 2
    WHEELS = 3
    SCAN = 4
    MARK = 5


class ScanCoding(IntEnum):
    """How the arrays of a scan are stored."""

    PLAIN = 0
    DEFLATED = 1  # bytes of equal significance side by side, then zlib


class Record(NamedTuple):
    """Where a sound record lies in the file: its payload [start, stop), and the next record."""

    kind: RecordKind
    start: int
    stop: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalHeader:
    """First record: what the replay must know before the first message.

    `clock` is "virtual" (simulated time) or "monotonic" (the host's).
    """

    package_version: str
    run_name: str
    clock: str
    config_toml: str
    format_version: int = FORMAT_VERSION


def encode_record(kind: RecordKind, payload: bytes) -> bytes:
    """Frame one payload."""
    body = _PREFIX.pack(len(payload), kind) + payload
    return body + _CRC.pack(zlib.crc32(body))


def find_record(data: bytes, offset: int) -> Record | None:
    """The sound record that begins at `offset`, or None."""
    if len(data) - offset < OVERHEAD:
        return None
    length, kind = _PREFIX.unpack_from(data, offset)
    start = offset + _PREFIX.size
    stop = start + length
    if not RecordKind.HEADER <= kind <= RecordKind.MARK or length > PAYLOAD_MAX:
        return None
    if stop + _CRC.size > len(data):
        return None
    if zlib.crc32(memoryview(data)[offset:stop]) != _CRC.unpack_from(data, stop)[0]:
        return None
    return Record(RecordKind(kind), start, stop, stop + _CRC.size)


def encode_header(header: JournalHeader) -> bytes:
    """The header as a record."""
    return encode_record(RecordKind.HEADER, json.dumps(asdict(header)).encode())


def decode_header(payload: bytes) -> JournalHeader:
    """Inverse of `encode_header`; unknown keys of later formats are ignored."""
    try:
        fields: Any = json.loads(payload)
        return JournalHeader(
            package_version=str(fields["package_version"]),
            run_name=str(fields["run_name"]),
            clock=str(fields["clock"]),
            config_toml=str(fields["config_toml"]),
            format_version=int(fields["format_version"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise WireError(f"journal header: not what was expected ({error!r})") from None


def encode_message(message: Message) -> bytes:
    """One message as a record."""
    match message:
        case ImuSample():
            return encode_record(RecordKind.IMU, _imu_payload(message))
        case WheelSample():
            return encode_record(RecordKind.WHEELS, _wheels_payload(message))
        case LaserScan():
            return encode_record(RecordKind.SCAN, _scan_payload(message))
        case Mark():
            text = json.dumps([message.kind, message.payload], separators=(",", ":"))
            return encode_record(RecordKind.MARK, _STAMP.pack(message.stamp_s) + text.encode())


def decode_message(kind: RecordKind, payload: bytes) -> Message:
    """Inverse of `encode_message`.

    Raises
    ------
    WireError
        If the payload cannot be of that kind (its CRC was right: another format wrote it).
    """
    try:
        match kind:
            case RecordKind.IMU:
                return _imu(payload)
            case RecordKind.WHEELS:
                return _wheels(payload)
            case RecordKind.SCAN:
                return _scan(payload)
            case RecordKind.MARK:
                word, details = json.loads(payload[_STAMP.size :])
                return Mark(stamp_s=_STAMP.unpack_from(payload)[0], kind=word, payload=details)
            case RecordKind.HEADER:
                raise WireError("journal: a second header")
    except (struct.error, zlib.error, ValueError) as error:
        raise WireError(
            f"journal: {kind.name.lower()} record cannot be read ({error})"
        ) from None


def _imu_payload(sample: ImuSample) -> bytes:
    field = sample.field_gauss
    return _IMU.pack(
        sample.stamp_s,
        sample.yaw_rate_radps,
        sample.temperature_c,
        field is not None,
        *(field or (0.0, 0.0, 0.0)),
    )


def _imu(payload: bytes) -> ImuSample:
    stamp_s, yaw_rate_radps, temperature_c, has_field, x, y, z = _IMU.unpack(payload)
    return ImuSample(
        stamp_s=stamp_s,
        yaw_rate_radps=yaw_rate_radps,
        field_gauss=(x, y, z) if has_field else None,
        temperature_c=temperature_c,
    )


def _wheels_payload(sample: WheelSample) -> bytes:
    flags = (
        _BUMPER * sample.bumper
        + _CLIFF * sample.cliff
        + _EMERGENCY_STOP * sample.emergency_stop
    )
    return (
        _WHEELS.pack(sample.stamp_s, sample.device_s, *sample.counts, flags, sample.battery_v)
        + sample.fault.encode()
    )


def _wheels(payload: bytes) -> WheelSample:
    stamp_s, device_s, a, b, c, flags, battery_v = _WHEELS.unpack_from(payload)
    return WheelSample(
        stamp_s=stamp_s,
        device_s=device_s,
        counts=(a, b, c),
        bumper=bool(flags & _BUMPER),
        cliff=bool(flags & _CLIFF),
        emergency_stop=bool(flags & _EMERGENCY_STOP),
        fault=payload[_WHEELS.size :].decode(),
        battery_v=battery_v,
    )


def _scan_payload(scan: LaserScan) -> bytes:
    arrays = (scan.bearings_rad, scan.ranges_m, scan.range_std_m, scan.beam_offsets_s)
    beams, counted = len(scan.ranges_m), len(scan.valid_counts)
    plain = b"".join(np.ascontiguousarray(a, dtype="<f8").tobytes() for a in arrays)
    plain += np.ascontiguousarray(scan.valid_counts, dtype="<i8").tobytes()
    # Neighbouring beams share sign, exponent and high mantissa bits; side by side they deflate.
    shuffled = np.frombuffer(plain, dtype=np.uint8).reshape(-1, 8).T.tobytes()
    deflated = zlib.compress(shuffled, 1)
    is_smaller = len(deflated) < len(plain)
    coding = ScanCoding.DEFLATED if is_smaller else ScanCoding.PLAIN
    head = _SCAN.pack(
        scan.stamp_s,
        scan.range_max_m,
        scan.rpm,
        scan.is_free_when_silent,
        beams,
        counted,
        coding,
    )
    return head + (deflated if is_smaller else plain)


def _scan(payload: bytes) -> LaserScan:
    stamp_s, range_max_m, rpm, is_free_when_silent, beams, counted, coding = _SCAN.unpack_from(
        payload
    )
    words = 4 * beams + counted
    plain = payload[_SCAN.size :]
    if ScanCoding(coding) is ScanCoding.DEFLATED:
        inflater = zlib.decompressobj()
        shuffled = inflater.decompress(plain, 8 * words + 1)
        plain = np.frombuffer(shuffled, dtype=np.uint8).reshape(8, -1).T.tobytes()
    if len(plain) != 8 * words:
        raise WireError(
            f"journal: scan of {beams} beams has {len(plain)} bytes, not {8 * words}"
        )
    floats = np.frombuffer(plain, dtype="<f8", count=4 * beams).reshape(4, beams)
    counts = np.frombuffer(plain, dtype="<i8", count=counted, offset=32 * beams)
    bearings_rad, ranges_m, range_std_m, beam_offsets_s = (
        row.astype(np.float64) for row in floats
    )
    return LaserScan(
        stamp_s=stamp_s,
        bearings_rad=bearings_rad,
        ranges_m=ranges_m,
        range_std_m=range_std_m,
        beam_offsets_s=beam_offsets_s,
        range_max_m=range_max_m,
        rpm=rpm,
        valid_counts=counts.astype(np.int64),
        is_free_when_silent=bool(is_free_when_silent),
    )
