# SPDX-License-Identifier: MIT
"""An XV-11 behind an XV Lidar Controller, byte for byte: a `WireDevice` over some `Optics`.

Commands go to `lrf_controller`, rotation comes from `lrf_rotor`, what the beams see from the
optics; this joins them on the wire: packets leave at the sensor's line speed as they fill up,
so replies land between and inside them, as on the real one. Quirks: docs/protocols.md.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from itertools import groupby

import numpy as np

from ins_robot.geometry.angles import wrap_rad
from ins_robot.sensing.drivers.lrf_codec import (
    BEAMS_PER_PACKET,
    BEAMS_PER_TURN,
    DISTANCE_MAX_MM,
    PACKET_BYTES,
    PACKET_LINE_TIME_S,
    PACKETS_PER_TURN,
    encode_packets,
)
from ins_robot.simulation.emulators.lrf_controller import (
    PWM_MAX,
    PWM_MIN,
    RPM_MAX,
    RPM_MIN,
    LidarController,
    as_lines,
)
from ins_robot.simulation.emulators.lrf_rotor import DuePacket, Rotor
from ins_robot.simulation.wire_device import Optics

SLOW_RPM = 180.0  # see the class
VERY_SLOW_RPM = 167.0
BANNER = (
    b"OK\n\rPiccolo Laser Distance Scanner\n\rCopyright (c) 2009-2010 Neato Robotics, Inc.\n\r"
    b"All Rights Reserved\n\r\n\rLoader\tV2.4.13386\n\rCPU\tF2802x/c600\n\r"
    b"Serial\tSIM00000AA-0000001\n\rLastCal\t[2010140429]\n\rRuntime\tV2.4.13386\n\r#"
)

_SLOW_CODE, _SLOW_STRENGTH = 0x22, 300
_VERY_SLOW_CODE, _VERY_SLOW_STRENGTH = 0x52, 968
_TOO_FAR_CODE = 0x03  # for a distance that does not fit the packet
_CUT_BYTES = 7  # of a packet, when the sensor restarts in its middle
_STALL_CHECK_S = 0.2
_STALL_PWM = 1000.0
_STALL_CHECKS_MAX = 10
_BEAMS_BACK = np.arange(BEAMS_PER_PACKET - 1, -1, -1.0)  # a packet's beams, from its last one

# distance_mm, strength, is_invalid, is_weak, error_code as in `PacketBatch`, each (n, 4)
Readings = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class LrfEmulator:
    """The device. Motor and raw relay are on at power-up, as on the real one.

    Parameters
    ----------
    optics : Optics
        What the beams see, in the LRF frame.
    rng : numpy.random.Generator
        For the speed ripple alone.
    yaw_rad, is_clockwise
        Bearing of the first beam, and the sense of rotation seen from above.
    rpm_ripple : float
        Standard deviation of the speed, as a share.
    slow_rpm, very_slow_rpm : float
        Below these every reading is "too slow": code 0x22, then 0x52 with packets half a turn
        apart. The one capture of a spin-down shows 0x22 from 207 rpm down, yet the paper and
        the controller's default run at 200 rpm; 180, the lowest specified speed, lets both be
        right. Pass 207 for the sensor of the capture.
    """

    def __init__(
        self,
        optics: Optics,
        rng: np.random.Generator,
        *,
        yaw_rad: float = 0.0,
        is_clockwise: bool = False,
        rpm_ripple: float = 0.003,
        slow_rpm: float = SLOW_RPM,
        very_slow_rpm: float = VERY_SLOW_RPM,
    ) -> None:
        self._optics = optics
        turned_rad = np.radians(np.arange(float(BEAMS_PER_TURN)))
        bearings_rad = wrap_rad(yaw_rad + (-turned_rad if is_clockwise else turned_rad))
        self._bearings_rad = bearings_rad.reshape(PACKETS_PER_TURN, BEAMS_PER_PACKET)
        self._slow_rpm = slow_rpm
        self._very_slow_rpm = min(very_slow_rpm, slow_rpm)
        self._controller = LidarController()
        self._rotor = Rotor(rng, rpm_ripple, self._very_slow_rpm)
        self._rotor.is_driven = self._controller.is_motor_on
        self._due: deque[DuePacket] = deque()
        self._sending = b""  # packets not yet wholly sent
        self._sending_full_s: list[float] = []  # when each of them was full
        self._sent = 0  # bytes of `_sending` that have left
        self._outbox = bytearray()
        self._reported_rpm = 0.0
        self._turn_s = math.nan  # when angle 0 last passed
        self._stall_check_s = -math.inf
        self._stall_checks = 0

    def receive(self, data: bytes, now_s: float) -> None:
        """Typed bytes; commands act at once, replies go out with the next `advance`."""
        self._live_until(now_s)
        controller = self._controller
        was_raw, was_on = controller.is_raw, controller.is_motor_on
        self._outbox += controller.receive(data)
        if was_raw and not controller.is_raw:
            self._drop_sending()
        if controller.is_motor_on and not was_on:
            self._stall_checks, self._stall_check_s = 0, now_s
        self._rotor.set_rpm = controller.set_rpm
        self._rotor.is_driven = controller.is_motor_on
        self._due.extend(self._rotor.turn_to(now_s))  # a rotor at rest begins to turn now

    def advance(self, now_s: float) -> bytes:
        """What was sent until `now_s`; b"" while the motor rests."""
        if self._rotor.is_at_rest and not self._due and not self._sending:
            if not self._outbox:
                return b""
        else:
            self._live_until(now_s)
        sent = bytes(self._outbox)
        self._outbox.clear()
        return sent

    def block_rotor(self) -> None:
        """Hold the rotor, as a finger or a chair would."""
        self._rotor.is_blocked = True

    def release_rotor(self) -> None:
        """Let go of it."""
        self._rotor.is_blocked = False

    def _live_until(self, now_s: float) -> None:
        self._due.extend(self._rotor.turn_to(now_s))
        full: list[DuePacket] = []
        while self._due and self._due[0].full_s <= now_s:
            full.append(self._due.popleft())
        if full:
            self._reported_rpm = full[-1].rpm
            self._measure(full)
        self._send_until(now_s)
        if self._rotor.restart_s is not None and self._rotor.restart_s <= now_s:
            self._rotor.restart_s = None
            self._restart_sensor()
        if self._controller.is_motor_on:
            self._check_stall(now_s)

    def _measure(self, full: list[DuePacket]) -> None:
        """Look along the beams of these packets, and queue or print what is seen."""
        controller = self._controller
        if controller.is_raw or controller.shows_dist:
            for sees, run in groupby(full, lambda packet: packet.rpm >= self._slow_rpm):
                packets = list(run)
                index = np.array([packet.place for packet in packets])
                readings = self._look(packets, index) if sees else self._fail(packets)
                if controller.is_raw:
                    rpm = np.array([packet.rpm for packet in packets])
                    self._sending += encode_packets(index, rpm, *readings)
                    self._sending_full_s += [packet.full_s for packet in packets]
                if controller.shows_dist:
                    self._print_distances(index, *readings[:4])
        self._print_turns(full)

    def _look(self, packets: list[DuePacket], index: np.ndarray) -> Readings:
        """What n packets' beams see, each (n, 4); one call to the optics."""
        full_s = np.array([packet.full_s for packet in packets])
        beam_s = np.array([packet.beam_s for packet in packets])
        stamps_s = full_s[:, None] - beam_s[:, None] * _BEAMS_BACK
        shape = stamps_s.shape
        seen = self._optics.measure(stamps_s.ravel(), self._bearings_rad[index].ravel())
        range_mm = 1e3 * seen.range_m
        is_invalid = ~(range_mm <= DISTANCE_MAX_MM)  # also NaN
        distance_mm = np.rint(np.where(is_invalid, 0.0, range_mm)).astype(np.int64)
        code = np.where(np.isnan(range_mm), seen.error_code, _TOO_FAR_CODE) * is_invalid
        return (
            distance_mm.reshape(shape),
            seen.strength.reshape(shape),
            is_invalid.reshape(shape),
            (seen.is_weak & ~is_invalid).reshape(shape),
            code.reshape(shape),
        )

    def _fail(self, packets: list[DuePacket]) -> Readings:
        """The same of a rotor that is too slow to see by."""
        is_very = np.array([[packet.rpm < self._very_slow_rpm] for packet in packets])
        none = np.zeros((len(packets), BEAMS_PER_PACKET), dtype=np.int64)
        is_invalid = np.ones(none.shape, dtype=bool)
        return (
            none,
            none + np.where(is_very, _VERY_SLOW_STRENGTH, _SLOW_STRENGTH),
            is_invalid,
            ~is_invalid,
            none + np.where(is_very, _VERY_SLOW_CODE, _SLOW_CODE),
        )

    def _send_until(self, now_s: float) -> None:
        """Move to the outbox what the sensor's line has carried by now."""
        if not self._sending:
            return
        begun = bisect_right(self._sending_full_s, now_s)
        line_s = now_s - self._sending_full_s[begun - 1]
        at_now = min(PACKET_BYTES, int(PACKET_BYTES * line_s / PACKET_LINE_TIME_S))
        sent = max(self._sent, PACKET_BYTES * (begun - 1) + at_now)
        self._outbox += self._sending[self._sent : sent]
        done = sent // PACKET_BYTES
        self._sending = self._sending[PACKET_BYTES * done :]
        del self._sending_full_s[:done]
        self._sent = sent - PACKET_BYTES * done

    def _drop_sending(self) -> None:
        self._sending = b""
        self._sending_full_s.clear()
        self._sent = 0

    def _restart_sensor(self) -> None:
        """Stopped: it breaks off a packet and prints its banner, once (in fact: in a loop)."""
        if self._controller.is_raw:
            cut = DuePacket(0.0, 0, self._reported_rpm, 0.0)
            packet = encode_packets(np.array([0]), np.array([cut.rpm]), *self._fail([cut]))
            self._outbox += self._sending[self._sent :] + packet[:_CUT_BYTES] + BANNER
        self._drop_sending()

    @property
    def _pwm(self) -> float:
        """What the regulator gives the motor; saturates when the rotor is held."""
        set_rpm = self._controller.set_rpm
        return min(PWM_MAX, max(PWM_MIN, 2.2 * set_rpm + 8.0 * (set_rpm - self._reported_rpm)))

    def _check_stall(self, now_s: float) -> None:
        """As the firmware: at full power and off the speed for over 2 s, the motor goes off."""
        if self._stall_check_s == -math.inf:
            self._stall_check_s = now_s
        while self._stall_check_s + _STALL_CHECK_S <= now_s:
            self._stall_check_s += _STALL_CHECK_S
            is_off = not RPM_MIN <= self._reported_rpm <= RPM_MAX and self._pwm > _STALL_PWM
            self._stall_checks = self._stall_checks + 1 if is_off else 0
            if self._stall_checks > _STALL_CHECKS_MAX:
                self._outbox += as_lines(self._controller.switch_motor(False))
                self._rotor.is_driven = False
                return

    def _print_turns(self, full: list[DuePacket]) -> None:
        """ShowRPM and ShowInterval: a line whenever angle 0 passes."""
        controller = self._controller
        for packet in full:
            if packet.place:
                continue
            if controller.shows_rpm:
                self._outbox += as_lines([f"R,{int(packet.rpm)},{int(self._pwm)}"])
            if controller.shows_interval and math.isfinite(self._turn_s):
                self._outbox += as_lines([f"T,{round(1e3 * (packet.full_s - self._turn_s))}"])
            self._turn_s = packet.full_s

    def _print_distances(
        self,
        index: np.ndarray,
        distance_mm: np.ndarray,
        strength: np.ndarray,
        is_invalid: np.ndarray,
        is_weak: np.ndarray,
    ) -> None:
        """ShowDist: a line per angle; bad ones with ShowErrors only."""
        angles = (BEAMS_PER_PACKET * index[:, None] + np.arange(BEAMS_PER_PACKET)).ravel()
        lines: list[str] = []
        for angle, distance, power, bad, weak in zip(
            angles.tolist(), distance_mm.ravel().tolist(), strength.ravel().tolist(),
            is_invalid.ravel().tolist(), is_weak.ravel().tolist(), strict=True,
        ):  # fmt: skip
            if not self._controller.angles[angle]:
                continue
            if not (bad or weak):
                lines.append(f"A,{angle},{distance},{power}")
            elif self._controller.shows_errors:
                lines.append(f"A,{angle},{'I' if bad else 'S'}")
        self._outbox += as_lines(lines)
