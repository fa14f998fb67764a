# SPDX-License-Identifier: MIT
"""The text side of the line: commands to the XV Lidar Controller, and what its lines mean.

Pure. The controller relays the sensor's bytes untouched and prints its replies in between; the
sensor itself prints a banner whenever it restarts. Source: getSurreal XV_Lidar_Controller, tags
v1.0 to v1.4.1, see docs/protocols.md.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

RPM_MIN, RPM_MAX = 200.0, 300.0  # what SetRPM is clamped to by firmware 1.2.2 and later

_VERSION = re.compile(r"XV Lidar Controller Firmware Version (\S+)")
_RELAY = re.compile(r"Relay: \d")  # GetConfig of firmware 1.0 and 1.1, which tells no version
_SET_RPM = re.compile(r"New RPM setpoint:? ?(\d+(?:\.\d+)?)")
_RUNTIME = re.compile(r"Runtime\s+(V\d+\.\d+\S*)")


def encode_commands(*commands: str) -> bytes:
    r"""Commands as bytes. The terminator is \n alone; unknown ones are ignored in silence."""
    return "".join(f"{command}\n" for command in commands).encode("ascii")


@dataclass(slots=True)
class ControllerState:
    """What the lines told so far; versions are "" while unknown.

    `set_rpm` is the set speed the controller confirmed in the last lines read, None if it did
    not.
    """

    version: str = ""
    sensor_version: str = ""
    sensor_restarts: int = 0
    set_rpm: float | None = None
    motor_off_replies: int = 0  # "Motor off" lines to come because they were asked for
    was_switched_off: bool = False  # by the controller itself, which the host did not ask for

    def read_line(self, line: str) -> None:
        """Take note of one line; what is not known is passed over."""
        if found := _SET_RPM.search(line):
            self.set_rpm = float(found[1])
        elif "Motor off" in line:
            if self.motor_off_replies:
                self.motor_off_replies -= 1
            else:
                self.was_switched_off = True
        elif found := _VERSION.search(line):
            self.version = found[1]
        elif _RELAY.search(line):
            self.version = "1.1"
        elif found := _RUNTIME.search(line):
            self.sensor_version = found[1]
            self.sensor_restarts += 1

    @property
    def stops_stalled_motor(self) -> bool:
        """Firmware 1.2.2 and later switch the motor off when it does not reach its speed."""
        return not self.version.startswith(("1.0", "1.1", "1.2.0", "1.2.1"))

    @property
    def raw_on(self) -> str:
        """The command that makes it relay the sensor's bytes."""
        return "RelayOn" if self.version.startswith(("1.0", "1.1")) else "ShowRaw"
