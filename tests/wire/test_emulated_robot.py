# SPDX-License-Identifier: MIT
"""The robot in real time: emulated devices in one process, the daemon in another, the CLI."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

INS_ROBOT = [sys.executable, "-m", "ins_robot"]


class Robot:
    """Two processes and their configuration."""

    def __init__(self, directory: Path, *options: str) -> None:
        self.config = directory / "emulated.toml"
        self.environment = os.environ | {"INS_ROBOT_CONFIG": str(self.config)}
        self.log = directory / "daemon.log"
        emulate = [*INS_ROBOT, "emulate", "rooms", "--config-out", str(self.config)]
        self.emulator = subprocess.Popen(
            [*emulate, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        wait_for(self.config.exists, "the emulated configuration")
        with self.log.open("w") as log:
            self.daemon = subprocess.Popen(
                [*INS_ROBOT, "daemon"], env=self.environment, stderr=log
            )

    def say(self, *words: str) -> subprocess.CompletedProcess[bytes]:
        command = [*INS_ROBOT, *words]
        return subprocess.run(command, env=self.environment, capture_output=True, check=False)

    def status(self) -> dict:
        done = self.say("status", "--json")
        return json.loads(done.stdout) if done.returncode == 0 else {"missing": ["daemon"]}

    def peak_rss_mb(self) -> float:
        lines = Path(f"/proc/{self.daemon.pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if "VmHWM" in line) / 1024.0

    def close(self) -> None:
        for process in (self.daemon, self.emulator):
            process.send_signal(signal.SIGTERM)
            process.wait(20)
        assert self.emulator.stdout is not None
        assert self.emulator.stdin is not None
        self.emulator.stdout.close()
        self.emulator.stdin.close()

    def carry(self, *numbers: float) -> str:
        """Type a line to the emulator; its answer."""
        assert self.emulator.stdout is not None
        assert self.emulator.stdin is not None
        print("carry", *numbers, file=self.emulator.stdin, flush=True)
        return self.emulator.stdout.readline()


def wait_for(is_true: Callable[[], bool], what: str, timeout_s: float = 40.0) -> None:
    """Poll a condition of another process."""
    until = time.monotonic() + timeout_s
    while not is_true():
        assert time.monotonic() < until, f"{what} did not come within {timeout_s} s"
        time.sleep(0.1)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    robot = Robot(tmp_path)
    try:
        yield robot
    finally:
        robot.close()


def test_a_run_from_start_to_map_in_real_time(robot: Robot, tmp_path: Path) -> None:
    wait_for(lambda: robot.status()["missing"] == [], "all three devices")
    assert robot.say("map").returncode == 1  # no map yet, and it says so
    assert robot.say("start", "--name", "lab").stdout.decode().strip() == "0001-lab"
    assert robot.say("start").returncode == 1  # one run at a time
    wait_for(lambda: robot.status().get("path_length_m", 0.0) > 0.3, "the robot driving")

    assert robot.say("map").stdout.startswith(b"\x89PNG")
    assert robot.say("map", "--format", "pgm").stdout.startswith(b"P5")
    assert b"resolution" in robot.say("map", "--format", "yaml").stdout

    assert robot.say("pause").returncode == 0
    assert robot.status()["state"] == "paused"
    assert robot.say("resume").returncode == 0

    assert robot.say("estop").returncode == 0
    stopped = robot.status()
    assert stopped["stop"] == "emergency stop by the operator"
    assert b"clear" in robot.say("resume").stderr  # latched: resume alone is refused
    assert robot.say("clear").returncode == 0
    assert robot.say("resume").returncode == 0

    assert robot.say("stop").returncode == 0
    runs = json.loads(robot.say("runs", "--json").stdout)
    assert [(run["name"], run["state"]) for run in runs] == [("0001-lab", "stopped")]
    out = tmp_path / "last.png"
    assert robot.say("map", "-o", str(out)).returncode == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert robot.say("runs", "delete", "0001-lab").returncode == 0
    assert json.loads(robot.say("runs", "--json").stdout) == []
    robot.emulator.send_signal(signal.SIGTERM)
    robot.emulator.wait(20)
    assert robot.say("status").returncode == 0  # the daemon outlives its devices
    assert robot.peak_rss_mb() <= 150.0
    assert "Traceback" not in robot.log.read_text()


def test_a_person_carries_the_lrf_in_real_time(tmp_path: Path) -> None:
    robot = Robot(tmp_path, "--set", "base.kind=manual")
    try:
        assert robot.emulator.stdout is not None
        assert "carry BEARING_DEG" in robot.emulator.stdout.readline()
        robot.emulator.stdout.readline()
        wait_for(lambda: robot.status()["missing"] == [], "the LRF")
        assert robot.say("scan").stdout.startswith(b"\x89PNG")
        assert robot.say("start").returncode == 0
        assert robot.say("here").stdout.startswith(b"go ")
        told = json.loads(robot.say("next", "--json").stdout)
        bearing, turn = math.degrees(told["bearing_rad"]), math.degrees(told["turn_rad"])
        assert robot.carry(bearing, told["distance_m"], turn).startswith("put down at ")
        assert robot.say("here").returncode == 0
        picture = tmp_path / "next.png"
        assert robot.say("next", "-o", str(picture)).returncode == 0
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert robot.status()["scans"] == 2
        assert robot.say("stop").stdout.strip() == b"0001-run"
        assert "Traceback" not in robot.log.read_text()
    finally:
        robot.close()


def test_another_program_reads_the_emulated_lrf(tmp_path: Path) -> None:
    """A reader made only from the public packet description sees full turns."""
    config = tmp_path / "emulated.toml"
    emulate = [*INS_ROBOT, "emulate", "rooms", "--config-out", str(config)]
    with subprocess.Popen(emulate, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            port = emulator.stdout.readline().split()[1]
            turns = _read_turns(port, seconds=6.0)
        finally:
            emulator.send_signal(signal.SIGTERM)
            emulator.wait(20)
    assert turns >= 3


def _read_turns(port: str, seconds: float) -> int:
    """Full turns seen: runs of 90 consecutive indexes, 0xFA, index, ..., checksum."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    os.write(fd, b"\nMotorOn\nShowRaw\n")
    data, until = b"", time.monotonic() + seconds
    while time.monotonic() < until:
        data += os.read(fd, 4096)
    os.close(fd)
    turns, expected, place = 0, 0xA0, 0
    while place + 22 <= len(data):
        packet = data[place : place + 22]
        if packet[0] != 0xFA or not 0xA0 <= packet[1] <= 0xF9 or not _is_sound(packet):
            place += 1
            continue
        expected = expected + 1 if packet[1] == expected else 0xA0
        if expected == 0xFA:
            turns, expected = turns + 1, 0xA0
        place += 22
    return turns


def _is_sound(packet: bytes) -> bool:
    total = 0
    for i in range(0, 20, 2):
        total = (total << 1) + packet[i] + (packet[i + 1] << 8)
    total = ((total & 0x7FFF) + (total >> 15)) & 0x7FFF
    return total == packet[20] + (packet[21] << 8)
