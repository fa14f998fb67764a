# SPDX-License-Identifier: MIT
"""The laser range finder (LRF): an XV-11 behind the XV Lidar Controller, on a serial line.

Bytes in, one `LaserScan` per revolution out. Holds the motor's set speed, and says what is
wrong when the rotor does not turn as it should. Decoding, timing, text and judging are pure, in
`lrf_codec`, `lrf_revolutions`, `lrf_controller` and `lrf_spin_watch`.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass

from ins_robot.config import LrfConfig
from ins_robot.errors import DeviceError
from ins_robot.messages import LaserScan
from ins_robot.sensing.drivers import lrf_controller as controller
from ins_robot.sensing.drivers.lrf_codec import LrfCodec, PacketBatch
from ins_robot.sensing.drivers.lrf_revolutions import RevolutionAssembler
from ins_robot.sensing.drivers.lrf_spin_watch import SpinWatch
from ins_robot.sensing.ports import ByteStream

log = logging.getLogger(__name__)

_RESTARTS_MAX = 2
_READ_TIMEOUT_S = 0.1
_REPLY_TIMEOUT_S = 0.5
_QUIET_S = 0.1  # a line silent for this long is drained
_DRAIN_TIMEOUT_S = 1.0
_LAST_BANNER_S = 1.0
_PENDING_S = 0.005  # what had arrived before comes faster than this
_DISCARD_TIMEOUT_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class LrfHealth:
    """Counters since construction, and what the far end said it is ("" while unknown)."""

    controller_version: str
    sensor_version: str
    is_motor_on: bool
    rpm: float
    set_rpm: float
    packets: int
    checksum_failures: int
    rejected_bytes: int
    revolutions: int
    incomplete_revolutions: int
    packets_missing: int
    sensor_restarts: int
    motor_restarts: int


class LrfDriver:
    """Driver of one LRF. Iterate `revolutions()` in one task: each revolution is given once.

    That task may run all the time, motor on or off, or only during a scan. The stream's
    `read()` must lose nothing when a timeout cancels it.
    """

    def __init__(
        self, stream: ByteStream, config: LrfConfig, clock: Callable[[], float]
    ) -> None:
        self._stream = stream
        self._config = config
        self._clock = clock
        self._codec = LrfCodec()
        self._controller = controller.ControllerState()
        self._assembler = RevolutionAssembler(config)
        self._watch = SpinWatch(config)
        self._ready: deque[LaserScan] = deque()
        self._motor_restarts = 0
        self._restarts_in_a_row = 0
        self._is_motor_on = False
        self._on_since_s = 0.0
        self._reading = asyncio.Lock()  # a stream has one reader at a time
        self._is_closed = False

    async def open(self) -> None:
        """Identify the controller, set the speed, and leave the motor off and raw data on.

        A far end that answers nothing may still be a bare XV-11: that is logged, and
        `revolutions` will tell if it is none.

        Raises
        ------
        DeviceError
            When the line breaks, or the sensor's firmware is not supported.
        """
        self._send("", "HideRaw", "RelayOff")  # RelayOff: firmware before 1.2
        await self._drain(_QUIET_S, _DRAIN_TIMEOUT_S)
        for question in ("ShowConfig", "GetConfig"):  # GetConfig: firmware before 1.2
            self._send(question)
            if await self._reply_until(lambda: bool(self._controller.version)):
                break
        self._log_identity()
        self._send(f"SetRPM {self._config.rpm:g}")
        await self._reply_until(lambda: self._controller.set_rpm is not None)
        if self.set_rpm != self._config.rpm:
            log.warning(
                "lrf: lrf.rpm = %g, but the controller takes %g..%g rpm: it turns at %g rpm",
                self._config.rpm,
                controller.RPM_MIN,
                controller.RPM_MAX,
                self.set_rpm,
            )
        self._send_motor_off()
        self._send(self._controller.raw_on)

    async def motor_on(self) -> None:
        """Start the motor; revolutions at the set speed follow after about a second."""
        if self._is_motor_on:
            return
        if not self._reading.locked():  # nobody iterates: packets of the last spin-down wait
            await self._drain(_PENDING_S, _DISCARD_TIMEOUT_S)
        self._ready.clear()
        self._assembler.reset()
        self._restarts_in_a_row = 0
        self._controller.was_switched_off = False
        self._is_motor_on = True
        self._on_since_s = self._clock()
        self._send("MotorOn")
        self._watch.start(self._on_since_s)

    async def motor_off(self) -> None:
        """Stop the motor. Revolutions not yet taken are dropped."""
        self._is_motor_on = False
        self._ready.clear()
        self._send_motor_off()

    def revolutions(self) -> AsyncIterator[LaserScan]:
        """Every full revolution while the motor is on, those of the spin-up included.

        `scan_filter.is_at_speed` tells the steady ones. Ends when this driver is closed.

        Raises
        ------
        DeviceError
            While iterating: the rotor does not turn even after restarts, the line broke, or
            the sensor's firmware is not supported.
        """
        return _Revolutions(self._next_revolution)

    @property
    def set_rpm(self) -> float:
        """The set speed in force: what was configured, clamped by the controller, or raised."""
        return self._watch.set_rpm

    @property
    def is_motor_on(self) -> bool:
        """Whether the motor is meant to turn."""
        return self._is_motor_on

    @property
    def health(self) -> LrfHealth:
        """Counters and versions, now."""
        counters = self._codec.counters
        return LrfHealth(
            controller_version=self._controller.version,
            sensor_version=self._controller.sensor_version,
            is_motor_on=self._is_motor_on,
            rpm=self._assembler.rpm,
            set_rpm=self.set_rpm,
            packets=counters.packets,
            checksum_failures=counters.checksum_failures,
            rejected_bytes=counters.rejected_bytes,
            revolutions=self._assembler.revolutions,
            incomplete_revolutions=self._assembler.incomplete,
            packets_missing=self._assembler.packets_missing,
            sensor_restarts=self._controller.sensor_restarts,
            motor_restarts=self._motor_restarts,
        )

    def close(self) -> None:
        """Stop the motor, if the line still carries, and close it; may be called again."""
        if self._is_closed:
            return
        self._is_closed = True
        try:
            self._send_motor_off()  # also before `open` got that far: it is on at power-up
        except DeviceError as error:
            log.warning("lrf: motor not stopped on closing: %s", error)
        self._is_motor_on = False
        self._stream.close()

    async def _next_revolution(self) -> LaserScan | None:
        while not self._ready:
            data = await self._read(_READ_TIMEOUT_S)
            if self._is_closed:
                return None
            self._take(data)
        return self._ready.popleft()

    async def _read(self, timeout_s: float) -> bytes:
        """What has arrived; b"" when nothing did in time, or when this driver was closed."""
        try:
            async with asyncio.timeout(timeout_s), self._reading:
                data = await self._stream.read()
        except TimeoutError:
            return b""
        if not data and not self._is_closed:
            raise DeviceError(
                f"lrf: {self._config.port}: the line was closed at the far end: USB unplugged?"
            )
        return data

    def _take(self, data: bytes) -> None:
        """Bytes that just arrived (b"": none for a while) go through decoding and judging."""
        now_s = self._clock()
        batch = self._codec.feed(data)
        if batch.lines:
            self._read_lines(batch.lines)
        self._refuse_firmware_21()
        if not self._is_motor_on:
            return
        self._ready.extend(self._assembler.push(batch, now_s))
        self._supervise(batch, now_s)

    def _supervise(self, batch: PacketBatch, now_s: float) -> None:
        watch = self._watch
        watch.see(batch, self._assembler.rpm, now_s)
        if watch.is_steady:
            self._restarts_in_a_row = 0
        faster_rpm = watch.faster_rpm()
        if faster_rpm is not None:
            log.warning(
                "lrf: most readings are 'too slow' at %.0f rpm: set speed raised to %.0f rpm",
                watch.set_rpm,
                faster_rpm,
            )
            watch.set_rpm = faster_rpm
            self._send(f"SetRPM {faster_rpm:g}")
            watch.start(now_s)
            return
        fault = watch.fault(now_s)
        if self._controller.was_switched_off:
            fault = "the controller switched the motor off (its stall protection)"
        if fault is not None:
            self._restart_motor(fault, now_s)

    def _restart_motor(self, fault: str, now_s: float) -> None:
        """Switch the motor on again, with all settings: the controller may have restarted."""
        if self._restarts_in_a_row >= _RESTARTS_MAX:
            self._is_motor_on = False
            self._ready.clear()
            self._send_motor_off()
            counters = self._codec.counters
            raise DeviceError(
                f"lrf: {self._config.port}: {fault}, after {_RESTARTS_MAX} restarts of the "
                f"motor ({counters.packets} good packets and {counters.rejected_bytes} other "
                f"bytes so far): rotor blocked, belt off or cable loose? Turn it by hand, "
                f"check the cable and lrf.port, and start again"
            )
        self._restarts_in_a_row += 1
        self._motor_restarts += 1
        self._controller.was_switched_off = False
        log.warning("lrf: %s: motor switched on again", fault)
        self._assembler.reset()
        self._send(f"SetRPM {self.set_rpm:g}", "MotorOn", self._controller.raw_on)
        self._watch.start(now_s)

    def _read_lines(self, lines: tuple[str, ...]) -> None:
        """Lines of text from between the packets."""
        state = self._controller
        restarts = state.sensor_restarts
        state.set_rpm = None
        for line in lines:
            state.read_line(line)
        if state.set_rpm is not None:
            self._watch.confirm(state.set_rpm)
        # A banner just after motor-on is the last stop's: printed when the head stood still.
        is_late = self._clock() - self._on_since_s > _LAST_BANNER_S
        if state.sensor_restarts > restarts and self._is_motor_on and is_late:
            log.warning(
                "lrf: the sensor restarted with the motor on (boot banner, firmware %s)",
                state.sensor_version,
            )

    def _refuse_firmware_21(self) -> None:
        counters = self._codec.counters
        is_banner_21 = self._controller.sensor_version.startswith("V2.1")
        if is_banner_21 or (counters.headers_21 and not counters.packets):
            raise DeviceError(
                f"lrf: {self._config.port}: unsupported firmware 2.1 of the XV-11 sensor "
                f"(frames start with 5A A5 00 C0, no checksums); use one with 2.4 or 2.6"
            )

    def _log_identity(self) -> None:
        state, port = self._controller, self._config.port
        if not state.version:
            log.warning("lrf: %s: no XV Lidar Controller answers; trying a bare XV-11", port)
            return
        log.info("lrf: %s: XV Lidar Controller, firmware %s", port, state.version)
        if not state.stops_stalled_motor:
            log.warning(
                "lrf: controller firmware %s does not stop a stalled motor; 1.2.2 and later do",
                state.version,
            )

    def _send_motor_off(self) -> None:
        self._controller.motor_off_replies += 1
        self._send("MotorOff")

    def _send(self, *commands: str) -> None:
        self._stream.write(controller.encode_commands(*commands))

    async def _drain(self, quiet_s: float, timeout_s: float) -> None:
        """Drop what comes until the line is quiet; one that never is, is left alone."""
        deadline_s = self._clock() + timeout_s
        while self._clock() < deadline_s and (data := await self._read(quiet_s)):
            self._read_lines(self._codec.feed(data).lines)
        self._codec.reset()

    async def _reply_until(self, is_answered: Callable[[], bool]) -> bool:
        """Read lines until `is_answered`, or in vain for half a second."""
        deadline_s = self._clock() + _REPLY_TIMEOUT_S
        while not is_answered() and (left_s := deadline_s - self._clock()) > 0.0:
            self._take(await self._read(left_s))
        return is_answered()


class _Revolutions:
    """Iterator without a finaliser: left half-way, it leaves nothing to clean up."""

    def __init__(self, next_revolution: Callable[[], Awaitable[LaserScan | None]]) -> None:
        self._next_revolution = next_revolution

    def __aiter__(self) -> _Revolutions:
        return self

    async def __anext__(self) -> LaserScan:
        revolution = await self._next_revolution()
        if revolution is None:
            raise StopAsyncIteration
        return revolution
