# SPDX-License-Identifier: MIT
"""The motor microcontroller (MCU): its frames, wheel loops, dead-man and latched faults.

Host bytes and encoder counts in, duties and telemetry bytes out; the hardware layer around it
only moves these (docs/protocols.md, "Motor microcontroller"). Runs unchanged under MicroPython
and under CPython, in the emulator and the host's codec: no numpy, asyncio or dataclasses.
"""

import struct

PROTOCOL = 1
FIRMWARE = (0, 1, 0)

# Frames: 00 COBS(kind, seq, payload, CRC-16 little-endian) 00. Bit 7 of kind: MCU to host.
HELLO, CONFIG, SET_POINT, REARM = 0x01, 0x02, 0x03, 0x04
HELLO_REPLY, CONFIG_REPLY, TELEMETRY = 0x81, 0x82, 0x83

HELLO_FORMAT = "<B"  # protocol of the host
CONFIG_FORMAT = "<HIII"  # dead_man_ms, counts_per_rev, speed_max, free_speed (mrad/s)
SET_POINT_FORMAT = "<iiiH"  # three wheel speeds (mrad/s), validity_ms
REARM_FORMAT = "<B"  # the fault meant; another one stays latched
HELLO_REPLY_FORMAT = "<BBBB"  # protocol, firmware major, minor, patch
# time_ms, three counts, inputs, fault, battery_mv, seq of the last set point, frames refused,
# dead-man stops
TELEMETRY_FORMAT = "<IiiiBBHBHH"
BATTERY_NOT_MEASURED = 0xFFFF

PAYLOAD_BYTES = {
    HELLO: struct.calcsize(HELLO_FORMAT),
    CONFIG: struct.calcsize(CONFIG_FORMAT),
    SET_POINT: struct.calcsize(SET_POINT_FORMAT),
    REARM: struct.calcsize(REARM_FORMAT),
    HELLO_REPLY: struct.calcsize(HELLO_REPLY_FORMAT),
    CONFIG_REPLY: struct.calcsize(CONFIG_FORMAT),
    TELEMETRY: struct.calcsize(TELEMETRY_FORMAT),
}
OVERHEAD_BYTES = 4  # kind, seq and CRC-16 around the payload
ENCODED_MAX = 64  # longest COBS text between two zero bytes

BUMPER, CLIFF, EMERGENCY_STOP = 0x01, 0x02, 0x04  # input bits

NO_FAULT, FAULT_NOT_CONFIGURED, FAULT_EMERGENCY_STOP = 0, 1, 2
FAULT_CLIFF, FAULT_BUMPER, FAULT_DEAD_MAN, FAULT_WHEEL = 3, 4, 5, 6
FAULT_OF_INPUT = (  # the worst first
    (EMERGENCY_STOP, FAULT_EMERGENCY_STOP),
    (CLIFF, FAULT_CLIFF),
    (BUMPER, FAULT_BUMPER),
)
COASTING_FAULTS = (FAULT_NOT_CONFIGURED, FAULT_EMERGENCY_STOP, FAULT_WHEEL)  # power off
BRAKING_FAULTS = (FAULT_CLIFF, FAULT_BUMPER)  # rest at once; a dead-man stop ramps down

TURN_RAD = 6.283185307179586
STEP_MS = 10
TELEMETRY_MS = 20
DEAD_MAN_MAX_MS = 2000  # a CONFIG that asks for more is refused
SEND_QUEUE_MAX = 512  # bytes kept while nobody fetches them
RAMP_RADPS2 = 40.0  # targets move no faster: from 0.2 m/s to rest in 0.1 s and 1 cm
LEAD_S = 0.02  # wheel loop: the feed-forward looks this far ahead along the ramp
FOLLOW_S = (
    0.06  # wheel loop: lag asked of a wheel; motors of 0.04 to 0.15 s follow without swing
)
GAIN = 1.5  # wheel loop: radps of push per radps of error
INTEGRAL_S = 0.15  # wheel loop: time in which the integral repeats that push
SMOOTHING = 0.4  # share of a new speed reading; one count in one step is 0.15 radps
REST_SHARE = 0.02  # of the free speed: slower than this with a target of 0 is rest
STALL_S = 0.5  # that long at STALL_DUTY without turning: the wheel does not follow
STALL_DUTY = 0.9
STALL_SHARE = 0.1  # of the wanted speed


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
        table.append(crc)
    return tuple(table)


_CRC_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE (0x1021, from 0xFFFF); 0x29B1 over b"123456789"."""
    crc = 0xFFFF
    table = _CRC_TABLE
    for byte in data:
        crc = ((crc << 8) & 0xFF00) ^ table[(crc >> 8) ^ byte]
    return crc


def wrap32(value: int) -> int:
    """Signed 32-bit value of the low 32 bits: the way from one wrapping reading to another."""
    return ((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def encode_frame(kind: int, seq: int, payload: bytes) -> bytes:
    """One frame, ready to send. The zero byte in front ends whatever noise came before."""
    body = bytes((kind, seq & 0xFF)) + payload
    body += struct.pack("<H", crc16(body))
    # COBS (Cheshire & Baker 1999): each run of non-zero bytes after its length + 1. Frames are
    # shorter than 254 bytes, so that no run needs splitting.
    return b"\0" + b"".join([bytes((len(r) + 1,)) + r for r in body.split(b"\0")]) + b"\0"


def decode_frame(encoded: bytes) -> tuple[int, int, bytes] | None:
    """(kind, seq, payload) of what stood between two zero bytes; None when it is no frame."""
    end = len(encoded)
    if end > ENCODED_MAX:
        return None
    body = bytearray()
    at = 0
    while at < end:
        stop = at + encoded[at]
        if stop > end:
            return None
        body += encoded[at + 1 : stop]
        at = stop
        if at < end:
            body.append(0)
    # The length first: it refuses most broken frames that a CRC of 16 bits would let by.
    if len(body) < OVERHEAD_BYTES or PAYLOAD_BYTES.get(body[0]) != len(body) - OVERHEAD_BYTES:
        return None
    if crc16(bytes(body[:-2])) != body[-2] | body[-1] << 8:
        return None
    return body[0], body[1], bytes(body[2:-2])


class FrameDecoder:
    """Bytes, cut anywhere and noisy, to frames; bounded; in step again at the next zero."""

    def __init__(self) -> None:
        self.rejected = 0
        self._partial = b""

    def feed(self, data: bytes) -> list[tuple[int, int, bytes]]:
        """The frames (kind, seq, payload) completed by `data`."""
        parts = (self._partial + data).split(b"\0")
        self._partial = parts.pop()[: ENCODED_MAX + 1]  # longer is refused at its end anyway
        frames = []
        for part in parts:
            if part:
                frame = decode_frame(part)
                if frame is None:
                    self.rejected += 1
                else:
                    frames.append(frame)
        return frames


class WheelLoop:
    """Speed of one wheel: ramp, feed-forward, and PI on what the wheel does else than expected.

    The expected reading is the target after FOLLOW_S and the smoothing: the natural lag of a
    motor then is no error, and nothing winds up while it follows.
    """

    def __init__(self) -> None:
        self.speed_radps = 0.0
        self.release()

    def release(self) -> None:
        """Coast: forget what was wanted."""
        self.target_radps = 0.0
        self.is_stalled = False
        self._followed_radps = 0.0
        self._expected_radps = 0.0
        self._integral_radps = 0.0
        self._stalled_s = 0.0

    def brake(self) -> None:
        """Rest is wanted now, without the ramp."""
        self.target_radps = self._followed_radps = self._expected_radps = 0.0

    def measure(self, turned_rad: float, dt_s: float) -> None:
        """Take in how far the wheel turned in `dt_s`."""
        self.speed_radps += SMOOTHING * (turned_rad / dt_s - self.speed_radps)
        self._expected_radps += SMOOTHING * (self._followed_radps - self._expected_radps)

    def drive(self, set_point_radps: float, free_speed_radps: float, dt_s: float) -> float:
        """Duty in [-1, 1] that takes the wheel to the set point."""
        step_max = RAMP_RADPS2 * dt_s
        step = min(step_max, max(-step_max, set_point_radps - self.target_radps))
        self.target_radps += step
        is_to_rest = set_point_radps == 0.0 and self.target_radps == 0.0
        if is_to_rest and abs(self.speed_radps) < REST_SHARE * free_speed_radps:
            self.release()  # no humming against friction
            return 0.0
        self._followed_radps += (
            (self.target_radps - self._followed_radps) * dt_s / (FOLLOW_S + dt_s)
        )
        error = self._expected_radps - self.speed_radps
        push = GAIN * error
        lead = self.target_radps + LEAD_S * step / dt_s
        wanted = (lead + push + self._integral_radps) / free_speed_radps
        duty = min(1.0, max(-1.0, wanted))
        if duty == wanted or wanted * error < 0.0:  # anti-windup: saturated, only towards less
            self._integral_radps += push * dt_s / INTEGRAL_S
        self._watch(duty, dt_s)
        return duty

    def _watch(self, duty: float, dt_s: float) -> None:
        """Stalled, or encoder dead or wired backwards: full duty turns nothing our way."""
        speed = self.speed_radps if duty > 0.0 else -self.speed_radps
        if abs(duty) < STALL_DUTY or speed > STALL_SHARE * abs(self.target_radps):
            self._stalled_s = 0.0
        else:
            self._stalled_s += dt_s
            self.is_stalled = self._stalled_s >= STALL_S


class MotorMcu:
    """The whole MCU but for its pins: `receive`, `step` every STEP_MS, `transmit`."""

    def __init__(self) -> None:
        self.dead_man_stops = 0
        self._is_configured = False
        self._dead_man_ms = 0
        self._rad_per_count = 0.0
        self._speed_max_radps = 0.0
        self._free_speed_radps = 0.0
        self._decoder = FrameDecoder()
        self._refused = 0
        self._latched = NO_FAULT
        self._rearm = NO_FAULT
        self._set_point = (0.0, 0.0, 0.0)
        self._set_point_seq = 0
        self._is_set_point_new = False
        self._set_point_ms = 0
        self._validity_ms = 0
        self._loops = (WheelLoop(), WheelLoop(), WheelLoop())
        self._duties = (0.0, 0.0, 0.0)
        self._is_started = False
        self._now_ms = 0
        self._counts = (0, 0, 0)
        self._telemetry_ms = 0
        self._seq = 0
        self._sending = b""

    @property
    def fault(self) -> int:
        """The latched fault; an MCU that just started is not configured, whatever else."""
        return self._latched if self._is_configured else FAULT_NOT_CONFIGURED

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, cut anywhere; wheels and latch obey at the next step."""
        for kind, seq, payload in self._decoder.feed(data):
            if kind == SET_POINT:
                self._receive_set_point(seq, payload)
            elif kind == REARM:
                self._rearm = payload[0]
            elif kind == CONFIG:
                self._receive_config(payload)
            elif kind == HELLO:
                self._send(HELLO_REPLY, struct.pack(HELLO_REPLY_FORMAT, PROTOCOL, *FIRMWARE))
            else:
                self._refused += 1

    def step(
        self, now_ms: int, counts: tuple[int, int, int], inputs: int, battery_mv: int
    ) -> tuple[float, float, float]:
        """One pass of the 100 Hz loop: the duty of each wheel, in [-1, 1].

        `now_ms` and `counts` wrap at 32 bits. `inputs` are the bits that are on now.
        """
        if not self._is_started:
            self._is_started = True
            self._now_ms, self._counts, self._telemetry_ms = now_ms, counts, now_ms
        dt_ms = wrap32(now_ms - self._now_ms)
        if dt_ms > 0:
            dt_s = dt_ms * 1e-3
            for i in (0, 1, 2):
                turned_counts = wrap32(counts[i] - self._counts[i])
                self._loops[i].measure(turned_counts * self._rad_per_count, dt_s)
            self._now_ms, self._counts = now_ms, counts
            self._judge(inputs)
            self._duties = self._drive(dt_s)
        if wrap32(now_ms - self._telemetry_ms) > TELEMETRY_MS - STEP_MS // 2:
            self._telemetry_ms = now_ms
            self._send_telemetry(inputs, battery_mv)
        return self._duties

    def transmit(self) -> bytes:
        """Take what there is to send to the host."""
        sending, self._sending = self._sending, b""
        return sending

    def _receive_set_point(self, seq: int, payload: bytes) -> None:
        a, b, c, self._validity_ms = struct.unpack(SET_POINT_FORMAT, payload)
        self._set_point_seq = seq
        if self.fault != NO_FAULT:
            return
        fastest = max(abs(a), abs(b), abs(c)) * 1e-3
        scale = 1e-3  # too fast: all together, so that the direction stays
        if fastest > self._speed_max_radps:
            scale *= self._speed_max_radps / fastest
        self._set_point = (a * scale, b * scale, c * scale)
        self._is_set_point_new = True

    def _receive_config(self, payload: bytes) -> None:
        dead_man_ms, counts_per_rev, speed_max, free_speed = struct.unpack(
            CONFIG_FORMAT, payload
        )
        if not (STEP_MS < dead_man_ms <= DEAD_MAN_MAX_MS and counts_per_rev):
            self._refused += 1
            return
        if not (speed_max and free_speed):
            self._refused += 1
            return
        self._dead_man_ms = dead_man_ms
        self._rad_per_count = TURN_RAD / counts_per_rev
        self._speed_max_radps = speed_max * 1e-3
        self._free_speed_radps = free_speed * 1e-3
        self._set_point = (0.0, 0.0, 0.0)
        self._is_configured = True
        self._send(CONFIG_REPLY, payload)

    def _judge(self, inputs: int) -> None:
        """Re-arm, latch, dead-man; in this order, so that an input still on latches again."""
        if self._rearm != NO_FAULT:
            if self._rearm == self._latched:
                self._latched = NO_FAULT
            self._rearm = NO_FAULT
        for bit, fault in FAULT_OF_INPUT:
            if inputs & bit and (self._latched == NO_FAULT or fault == FAULT_EMERGENCY_STOP):
                self._latched = fault
                break
        if self._is_set_point_new:
            self._is_set_point_new = False
            self._set_point_ms = self._now_ms
        is_driving = any(self._set_point)
        age_ms = wrap32(self._now_ms - self._set_point_ms)
        if is_driving and age_ms > min(self._validity_ms, self._dead_man_ms):
            self.dead_man_stops += 1
            self._latched = self._latched or FAULT_DEAD_MAN
        if self._latched != NO_FAULT:
            self._set_point = (0.0, 0.0, 0.0)

    def _drive(self, dt_s: float) -> tuple[float, float, float]:
        a, b, c = self._loops
        if self.fault in COASTING_FAULTS:
            for loop in self._loops:
                loop.release()
            return (0.0, 0.0, 0.0)
        if self._latched in BRAKING_FAULTS:
            for loop in self._loops:
                loop.brake()
        free = self._free_speed_radps
        want_a, want_b, want_c = self._set_point
        duties = (
            a.drive(want_a, free, dt_s),
            b.drive(want_b, free, dt_s),
            c.drive(want_c, free, dt_s),
        )
        if a.is_stalled or b.is_stalled or c.is_stalled:
            self._latched = self._latched or FAULT_WHEEL
        return duties

    def _send_telemetry(self, inputs: int, battery_mv: int) -> None:
        a, b, c = self._counts
        self._send(
            TELEMETRY,
            struct.pack(
                TELEMETRY_FORMAT,
                self._now_ms & 0xFFFFFFFF,
                wrap32(a),
                wrap32(b),
                wrap32(c),
                inputs,
                self.fault,
                battery_mv,
                self._set_point_seq,
                (self._refused + self._decoder.rejected) & 0xFFFF,
                self.dead_man_stops & 0xFFFF,
            ),
        )

    def _send(self, kind: int, payload: bytes) -> None:
        if len(self._sending) > SEND_QUEUE_MAX:  # nobody fetches: the newest matter
            self._sending = b""
        self._sending += encode_frame(kind, self._seq, payload)
        self._seq = self._seq + 1 & 0xFF
