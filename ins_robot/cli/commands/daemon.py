# SPDX-License-Identifier: MIT
"""`ins-robot daemon`: run the robot until SIGTERM or SIGINT."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ins_robot.cli.config_source import (
    add_config_argument,
    add_set_argument,
    find_config,
    load_config,
)
from ins_robot.cli.left_unseen import left_words

if TYPE_CHECKING:
    from ins_robot.config import Config
    from ins_robot.core.run_result import RunResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `daemon`."""
    add_set_argument(parser)
    add_config_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Serve; 0 after a signal asked it to end."""
    import asyncio
    import logging

    from ins_robot.daemon.logging_setup import banner, set_up

    config = load_config(args)
    set_up(config.daemon.log_level)
    banner(logging.getLogger("ins_robot"), config, find_config(getattr(args, "config", None)))
    asyncio.run(_serve(config))
    return 0


def tell_left(result: RunResult) -> RunResult:
    """Log what the run that ends has left unseen."""
    import logging

    if words := left_words(result.notes):
        logging.getLogger("ins_robot").warning("%s: %s", result.name, words)
    return result


async def _serve(config: Config) -> None:
    import asyncio
    import signal
    from pathlib import Path

    from ins_robot.daemon.commands import DaemonCommands
    from ins_robot.daemon.control_socket import ControlSocket
    from ins_robot.daemon.run_store import RunStore
    from ins_robot.daemon.runtime import Robot
    from ins_robot.daemon.systemd_notify import SystemdNotifier
    from ins_robot.sensing.drivers.connector import SystemConnector

    notifier = SystemdNotifier.from_environment()
    store = RunStore(
        Path(config.daemon.runs),
        keep_runs=config.daemon.keep_runs,
        keep_free_mb=config.daemon.keep_free_mb,
    )
    store.open()
    robot = Robot(config, SystemConnector(), notifier=notifier, annotate=tell_left)
    socket = ControlSocket(Path(config.daemon.socket), DaemonCommands(robot, store))
    await socket.open()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(
            number, robot.supervisor.shut_down, f"signal {signal.Signals(number).name}"
        )
    notifier.ready(f"control socket {config.daemon.socket}")
    try:
        await robot.serve()
    finally:
        notifier.stopping()
        await socket.close()
        notifier.close()
