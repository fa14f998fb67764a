# SPDX-License-Identifier: MIT
"""The XV Lidar Controller's text side, firmware 1.4.x: commands in, settings and replies out.

Replies are those of getSurreal XV_Lidar_Controller v1.4.1 (which calls itself 1.4.0), byte for
byte, except that Help lists the bare names. The sensor's bytes are relayed by `emulators.lrf`.
"""

from __future__ import annotations

import re
from collections.abc import Callable

RPM_MIN, RPM_MAX = 200.0, 300.0
PWM_MIN, PWM_MAX = 100.0, 1023.0
VERSION = "1.4.0"

_BUFFER_CHARS = 100
_ANGLES = 360
_FIRST_PRINTABLE, _LAST_PRINTABLE = 0x20, 0x7E
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_ANGLE_RANGE = re.compile(r"(\d+)(?:-(\d+))?,?")


class LidarController:
    """Settings as they are in force; each `receive` returns what is printed.

    Attributes
    ----------
    is_motor_on, is_raw, shows_dist, shows_rpm, shows_interval, shows_errors : bool
        What is switched on. Motor and raw relay are on at power-up.
    set_rpm : float
        The set speed, clamped to 200..300.
    angles : list of bool
        Which of the 360 angles ShowDist prints.
    """

    def __init__(self) -> None:
        self._typed = bytearray()
        self._reset()
        self._commands: dict[str, Callable[[list[str]], list[str]]] = {
            "HELP": self._help,
            "?": self._help,
            "SHOWCONFIG": self._show_config,
            "SAVECONFIG": lambda _: ["Config Saved."],
            "RESETCONFIG": lambda _: self._reset(),
            "SETANGLE": self._set_angle,
            "SETRPM": self._set_rpm,
            "SETKP": lambda words: self._set_tuning("Kp", words, "SetKp 1.0"),
            "SETKI": lambda words: self._set_tuning("Ki", words, "SetKi 0.5"),
            "SETKD": lambda words: self._set_tuning("Kd", words, "SetKd 0.001"),
            "SETSAMPLETIME": lambda words: self._set_tuning(
                "Sample time", words, "SetSampleTime 20"
            ),
            "MOTOROFF": lambda _: self.switch_motor(False),
            "MOTORON": lambda _: self.switch_motor(True),
            "SHOWRAW": self._show_raw,
            "HIDERAW": self._hide_raw,
            "SHOWDIST": self._show_dist,
            "HIDEDIST": self._hide_dist,
            "SHOWRPM": self._show_rpm,
            "HIDERPM": self._hide_rpm,
            "SHOWERRORS": lambda _: self._show_errors(True),
            "HIDEERRORS": lambda _: self._show_errors(False),
            "SHOWINTERVAL": lambda _: self._show_interval(True),
            "HIDEINTERVAL": lambda _: self._show_interval(False),
            "SHOWALL": self._show_all,
            "HIDEALL": self._hide_all,
        }

    def receive(self, data: bytes) -> bytes:
        r"""Take typed bytes, run the commands a \n completed; return what they print."""
        replies: list[str] = []
        for byte in data:
            if byte == ord("\n"):
                replies += self._run(self._typed.decode("ascii").upper())
                self._typed.clear()
            elif (
                _FIRST_PRINTABLE <= byte <= _LAST_PRINTABLE and len(self._typed) < _BUFFER_CHARS
            ):
                self._typed.append(byte)
        return as_lines(replies)

    def switch_motor(self, is_on: bool) -> list[str]:
        """As MotorOn and MotorOff do, and the stall protection."""
        self.is_motor_on = is_on
        return [" ", "Motor on" if is_on else "Motor off"]

    def _run(self, line: str) -> list[str]:
        words = line.split(" ")
        words = [word for word in words if word]
        command = self._commands.get(words[0]) if words else None
        return command(words[1:]) if command else []  # unknown ones are ignored in silence

    def _reset(self) -> list[str]:
        """Defaults, which include motor and raw relay on; prints nothing."""
        self.is_motor_on = self.is_raw = True
        self.shows_dist = self.shows_rpm = self.shows_interval = self.shows_errors = False
        self.set_rpm = 200.0
        self.angles = [True] * _ANGLES
        self._tunings = {"Kp": 2.0, "Ki": 1.0, "Kd": 0.0, "Sample time": 20.0}
        return []

    def _set_rpm(self, words: list[str]) -> list[str]:
        if len(words) != 1:
            prefix = self._clamped_rpm(words[0])[1] if words else []
            return [*prefix, " ", "Incorrect syntax.  Example: SetRPM 200"]
        rpm, printed = self._clamped_rpm(words[0])
        printed += [f"Old RPM setpoint:{self.set_rpm:.2f}", f"New RPM setpoint: {rpm:.2f}"]
        self.set_rpm = rpm
        return printed

    @staticmethod
    def _clamped_rpm(word: str) -> tuple[float, list[str]]:
        rpm = _as_number(word)
        if rpm < RPM_MIN:
            return RPM_MIN, [" ", f"RPM too low. Setting to minimum {RPM_MIN:.2f}"]
        if rpm > RPM_MAX:
            return RPM_MAX, [" ", f"RPM too high. Setting to maximum {RPM_MAX:.2f}"]
        return rpm, []

    def _set_tuning(self, name: str, words: list[str], example: str) -> list[str]:
        if len(words) != 1:
            return [" ", f"Incorrect syntax.  Example: {example}"]
        value = _as_number(words[0])
        self._tunings[name] = float(int(value)) if name == "Sample time" else value
        return [" ", f"Setting {name} to: {self._tunings[name]:.2f}"]

    def _hide_raw(self, _: list[str]) -> list[str]:
        self.is_raw = False
        return []

    def _show_raw(self, words: list[str]) -> list[str]:
        self.is_raw = True
        return self._hide_dist(words) + self._hide_rpm(words)

    def _show_dist(self, _: list[str]) -> list[str]:
        self.is_raw = False
        was_shown, self.shows_dist = self.shows_dist, True
        return [] if was_shown else [" ", "Code,Angle,Distance(mm),Signal strength"]

    def _hide_dist(self, _: list[str]) -> list[str]:
        self.shows_dist = False
        return [" ", "Hiding Distance data"]

    def _show_rpm(self, _: list[str]) -> list[str]:
        self.is_raw, self.shows_rpm = False, True
        return self._unless_dist("Showing RPM data")

    def _hide_rpm(self, _: list[str]) -> list[str]:
        self.shows_rpm = False
        return self._unless_dist("Hiding RPM data")

    def _show_errors(self, is_shown: bool) -> list[str]:
        self.shows_errors = is_shown
        return self._unless_dist("Showing errors" if is_shown else "Hiding errors")

    def _show_interval(self, is_shown: bool) -> list[str]:
        self.shows_interval = is_shown
        return self._unless_dist(
            "Showing time interval (ms per revolution)" if is_shown else "Hiding time interval"
        )

    def _unless_dist(self, text: str) -> list[str]:
        """Most messages stay away while distances are printed."""
        return [] if self.shows_dist else [" ", text]

    def _show_all(self, words: list[str]) -> list[str]:
        printed = self._show_dist(words) + self._show_errors(True)
        return printed + self._show_rpm(words) + self._show_interval(True)

    def _hide_all(self, words: list[str]) -> list[str]:
        printed = self._hide_dist(words) + self._show_errors(False)
        return printed + self._hide_rpm(words) + self._show_interval(False)

    def _set_angle(self, words: list[str]) -> list[str]:
        self.angles = [False] * _ANGLES
        ranges = [_ANGLE_RANGE.fullmatch(word) for word in words]
        is_right = bool(ranges)
        for found in ranges:
            first = int(found[1]) if found else _ANGLES
            last = int(found[2] or first) if found else _ANGLES
            if not first <= last < _ANGLES:
                is_right = False
                break
            self.angles[first : last + 1] = [True] * (last + 1 - first)
        if is_right:
            return ["", "Angles:" + self._angle_list(), *self._show_dist(words)]
        return [
            " ",
            "Incorrect syntax",
            "  Example: SetAngle 0, 15-30, 45-50, 10",
            "  Example: SetAngle 0-359 to show all angles.",
            "Notes: Use a space after each comma",
            "       No particular order is required",
            "       In a from-to pair, the 1st value must be lowest. "
            "From-to pairs can overlap ranges.",
        ]

    def _angle_list(self) -> str:
        return "".join(f"{angle}," for angle, is_shown in enumerate(self.angles) if is_shown)

    def _help(self, _: list[str]) -> list[str]:
        self.is_raw = False
        names = [f"  {name}" for name in self._commands]
        title = f"XV Lidar Controller Firmware Version {VERSION}"
        return [" ", " ", title, "GetSurreal.com * ", " ", "List of available commands", *names]

    def _show_config(self, _: list[str]) -> list[str]:
        self.is_raw = False
        tunings = self._tunings
        return [
            " ",
            " ",
            f"XV Lidar Controller Firmware Version {VERSION}",
            "GetSurreal.com ",
            " ",
            "PWM pin: 4",
            f"Target RPM: {self.set_rpm:.2f}",
            f"Max PWM: {PWM_MAX:.2f}",
            f"Min PWM: {PWM_MIN:.2f}",
            f"PID Kp: {tunings['Kp']:.2f}",
            f"PID Ki: {tunings['Ki']:.2f}",
            f"PID Kd: {tunings['Kd']:.2f}",
            f"SampleTime: {tunings['Sample time']:.0f}",
            f"Motor Enable: {self.is_motor_on:d}",
            f"Show Raw Data: {self.is_raw:d}",  # always 0: this command has just hidden it
            f"Show Dist Data: {self.shows_dist:d}",
            f"Show RPM Data: {self.shows_rpm:d}",
            f"Show Time Interval: {self.shows_interval:d}",
            f"Show Angle(s): {self._angle_list()} ",
            " ",
        ]


def as_lines(lines: list[str]) -> bytes:
    """Lines as the controller's println sends them."""
    return "".join(f"{line}\r\n" for line in lines).encode("ascii")


def _as_number(word: str) -> float:
    """As C's atof: the number a word begins with, 0 when it does not."""
    found = _NUMBER.match(word)
    return float(found[0]) if found else 0.0
