# SPDX-License-Identifier: MIT
"""`ins-robot emulate`: the simulated robot's devices in real time, on ptys and a Unix socket.

The file of `--config-out` is a whole configuration: `INS_ROBOT_CONFIG=FILE ins-robot daemon`
and the client commands run on these devices. Any program that speaks XV-11 may open the LRF's
line. With `base.kind=manual` there is the LRF alone, and lines on stdin carry it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ins_robot.cli.commands.simulate import (
    add_start_argument,
    add_world_argument,
    check_seed,
    parse_start,
)
from ins_robot.cli.config_source import add_config_argument, add_set_argument, load_config
from ins_robot.errors import InputError

if TYPE_CHECKING:
    from ins_robot.config import Config
    from ins_robot.simulation.harness import SimulatedRobot

SOCKET_PATH_MAX_BYTES = 100  # Linux takes 107; the lock beside it has a longer name
HEADER = "# Written by `ins-robot emulate`; good while it runs.\n\n"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `emulate`."""
    add_world_argument(parser)
    parser.add_argument(
        "--config-out",
        metavar="FILE",
        type=Path,
        required=True,
        help="write the configuration for `daemon` and the client commands here",
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of all noise (default 0)"
    )
    add_start_argument(parser)
    add_set_argument(parser)
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the devices until SIGTERM or SIGINT."""
    import asyncio
    import time

    from ins_robot.simulation.harness import SimulatedRobot
    from ins_robot.simulation.world import World

    check_seed(args.seed)
    check_config_out(args.config_out)
    config = load_config(args)
    world = World.find(args.world)
    start = world.start_pose(parse_start(args.start), config.robot.radius_m)
    simulated = SimulatedRobot(config, world, start, args.seed, time.monotonic())
    # Short: the path of a Unix socket may have no more than 107 bytes.
    with tempfile.TemporaryDirectory(prefix="ins-robot-") as lines:
        emulated = emulated_config(config, Path(lines), args.config_out)
        with only_emulator(Path(emulated.daemon.runs), args.config_out):
            asyncio.run(_serve(simulated, emulated, args.config_out))
    return 0


@contextlib.contextmanager
def only_emulator(runs: Path, config_out: Path) -> Iterator[None]:
    """Refuse a second emulator with one configuration while the first one runs."""
    import fcntl

    runs.mkdir(parents=True, exist_ok=True)
    with (runs / ".emulator.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"--config-out {config_out}: another `ins-robot emulate` runs with it; end "
                "that one, or name another file"
            ) from None
        yield


def check_config_out(path: Path) -> None:
    """Refuse to replace what this command has not written."""
    if not path.exists():
        return
    if not path.is_file() or not path.read_bytes().startswith(HEADER.encode()):
        raise InputError(
            f"--config-out {path}: is there already, and not from `emulate`; name another file"
        )


def emulated_config(config: Config, lines: Path, config_out: Path) -> Config:
    """The configuration with every device on a line in `lines`.

    Runs and control socket are beside `config_out`: a daemon outlives its emulator, and is
    still to be reached then.
    """
    from dataclasses import replace

    runs = config_out.absolute().with_suffix(".runs")
    socket = runs / "control.sock"
    if len(os.fsencode(socket)) > SOCKET_PATH_MAX_BYTES:
        digest = zlib.crc32(os.fsencode(runs))
        socket = Path(tempfile.gettempdir(), f"ins-robot-{os.getuid()}-{digest:08x}.sock")
    return replace(
        config,
        lrf=replace(config.lrf, port=str(lines / "lrf")),
        wheels=replace(config.wheels, port=str(lines / "motors")),
        imu=replace(config.imu, bus=f"unix:{lines / 'imu.sock'}"),
        daemon=replace(config.daemon, socket=str(socket), runs=str(runs)),
    )


async def _serve(simulated: SimulatedRobot, config: Config, config_out: Path) -> None:
    import asyncio
    import signal

    from ins_robot.config import to_toml
    from ins_robot.logs.run_directory import write_atomically

    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    async with contextlib.AsyncExitStack() as devices:
        if config.base.kind == "manual":
            told = await _open_carried(simulated, config, devices)
        else:
            told = await _open_all(simulated, config, devices)
        write_atomically(config_out, (HEADER + to_toml(config)).encode())
        print(told)
        print(f"ready: INS_ROBOT_CONFIG={config_out} ins-robot daemon", flush=True)
        await ended.wait()
    print("emulation ended", file=sys.stderr)


async def _open_all(
    simulated: SimulatedRobot, config: Config, devices: contextlib.AsyncExitStack
) -> str:
    """LRF, motors and IMU; where they are."""
    import asyncio

    from ins_robot.simulation.i2c_socket import I2cSocketServer
    from ins_robot.simulation.pty_wire import PtyWire

    bus = Path(config.imu.bus.removeprefix("unix:"))
    lrf = PtyWire(simulated.lrf, Path(config.lrf.port))
    motors = PtyWire(simulated.motors, Path(config.wheels.port))
    imu = I2cSocketServer(simulated.registers, bus, asyncio.get_running_loop().time)
    await lrf.open()
    devices.callback(lrf.close)
    await motors.open()
    devices.callback(motors.close)
    await imu.start()
    devices.push_async_callback(imu.close)
    return f"lrf {config.lrf.port}  motors {config.wheels.port}  imu {config.imu.bus}"


async def _open_carried(
    simulated: SimulatedRobot, config: Config, devices: contextlib.AsyncExitStack
) -> str:
    """The LRF alone, carried by lines on stdin; where it is and how."""
    import asyncio

    from ins_robot.simulation.carry_orders import USAGE, obey
    from ins_robot.simulation.pty_wire import PtyWire

    lrf = PtyWire(simulated.lrf, Path(config.lrf.port))
    await lrf.open()
    devices.callback(lrf.close)
    loop = asyncio.get_running_loop()
    living = loop.create_task(simulated.be_carried())
    devices.callback(living.cancel)

    pending = bytearray()

    def read() -> None:
        received = os.read(sys.stdin.fileno(), 4096)
        if not received:
            loop.remove_reader(sys.stdin)
        *lines, pending[:] = (pending + received).split(b"\n")
        for line in filter(bytearray.strip, lines):
            print(obey(simulated.person, line.decode(errors="replace")), flush=True)

    try:
        loop.add_reader(sys.stdin, read)
    except OSError:  # /dev/null or a file, which a selector does not take
        return f"lrf {config.lrf.port}  (stdin is no terminal and no pipe: nobody carries it)"
    devices.callback(loop.remove_reader, sys.stdin)
    return f"lrf {config.lrf.port}  type here to carry it: {USAGE}"
