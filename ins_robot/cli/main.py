# SPDX-License-Identifier: MIT
"""The `ins-robot` command: a table of commands, and one module each, imported when chosen.

A command module has `add_arguments(parser)` and `run(args) -> int` (the exit code), and imports
what is heavy inside `run`. Data goes to stdout, words to stderr. A known error (RobotError) is
one line (a configuration: one for each flaw) and exit code 1; wrong usage is 2; anything else
is a bug and keeps its traceback.
"""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

from ins_robot import __version__
from ins_robot.errors import ConfigError, RobotError

EXIT_ERROR = 1
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells count
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE


@dataclass(frozen=True, slots=True)
class Command:
    """A line of `--help`, and the module in `cli/commands` that does the work."""

    name: str
    module: str
    summary: str


COMMANDS = (
    Command("daemon", "daemon", "run the robot: devices, estimation, exploration"),
    Command("start", "start", "begin a run: explore and map"),
    Command("stop", "order", "end the run; its map is saved"),
    Command("pause", "order", "stand still; the run goes on with `resume`"),
    Command("resume", "order", "go on after `pause`; the robot looks where it is first"),
    Command("estop", "order", "stop the motors at once; latched until `clear`"),
    Command("clear", "order", "release the emergency stop and latched faults"),
    Command("status", "status", "what the robot is doing"),
    Command("goto", "goto", "drive to a place of the map"),
    Command("zones", "zones", "no-go zones and virtual walls: add, list, remove"),
    Command("map", "fetch_map", "the running map, or the last finished one"),
    Command("next", "where_next", "where the run goes next, in words and on the map"),
    Command("here", "here", "manual base: scan where the LRF was put down"),
    Command("scan", "fetch_scan", "take one scan and show it as a polar plot"),
    Command("runs", "runs", "list the recorded runs, or delete some"),
    Command("check-config", "check_config", "check a configuration file"),
    Command("simulate", "simulate", "explore a simulated world with the whole daemon"),
    Command("replay", "replay", "run the core on a recording or a log"),
    Command("localize", "localize", "where on a finished map a log's robot is"),
    Command("emulate", "emulate", "the devices in real time, for `daemon` and other programs"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # Small matrices only: more BLAS threads cost time, and most on a Pi.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    arguments = with_values(sys.argv[1:] if argv is None else argv)
    try:
        code = _run(arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output has left (`ins-robot runs | head -1`). Python flushes stdout
        # once more at exit; let that go nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except ConfigError as error:
        return max(map(_report, str(error).splitlines()))  # one line for each flaw
    except RobotError as error:
        return _report(str(error))
    except OSError as error:
        if error.filename is None:
            raise  # no file named: nothing the user could act on, so keep the traceback
        return _report(f"{error.filename}: {error.strerror}")
    return code


def with_values(words: Sequence[str]) -> list[str]:
    """The words with `--start -1,2` as `--start=-1,2`: argparse takes -1,2 for an option."""
    joined: list[str] = []
    for word in words:
        if re.match(r"-[\d.]", word) and joined and re.fullmatch(r"--[\w-]+", joined[-1]):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _run(arguments: Sequence[str]) -> int:
    parser, subparsers = _parsers()
    chosen = next((word for word in arguments if not word.startswith("-")), None)
    module: ModuleType | None = None
    for command in COMMANDS:
        if command.name == chosen:
            module = importlib.import_module(f"ins_robot.cli.commands.{command.module}")
            module.add_arguments(subparsers[command.name])
    if module is None and chosen is not None:
        parser.exit(2, _unknown(chosen) + "\n")
    args, strange = parser.parse_known_args(arguments)
    if strange:
        told = parser if chosen is None else subparsers[chosen]
        hint = _config_hint(strange, can_set="overrides" in args)
        told.error(f"unrecognized arguments: {' '.join(strange)}{hint}")
    if module is None:
        parser.print_help(sys.stderr)
        return 2
    code: int = module.run(args)
    return code


def _unknown(name: str) -> str:
    near = difflib.get_close_matches(name, [command.name for command in COMMANDS], n=1)
    hint = f"did you mean `ins-robot {near[0]}`? " if near else ""
    return f"ins-robot: no command {name!r}: {hint}`ins-robot --help` lists them"


def _config_hint(words: Sequence[str], *, can_set: bool) -> str:
    """Where a word is named like an option of the configuration: that it is one."""
    from dataclasses import fields

    from ins_robot.config import Config

    names = {word.partition("=")[0].lstrip("-").replace("-", "_") for word in words}
    keys = [
        f"{section.name}.{option.name}"
        for section in fields(Config)
        for option in fields(getattr(Config(), section.name))
        if option.name in names
    ]
    if not keys:
        return ""
    how = f", here with --set {keys[0]}=VALUE" if can_set else ""
    return f"; {' or '.join(keys)} is an option of the configuration{how}"


def _parsers() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    width = max(len(command.name) for command in COMMANDS)
    table = "\n".join(f"  {command.name:<{width}}  {command.summary}" for command in COMMANDS)
    parser = argparse.ArgumentParser(
        prog="ins-robot",
        usage="ins-robot [-h] [--version] COMMAND ...",
        description="A robot that explores an unknown building by itself and maps it."
        f"\n\ncommands:\n{table}",
        epilog="`ins-robot COMMAND --help` tells the options of a command.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"ins-robot {__version__}")
    group = parser.add_subparsers(dest="command", metavar="COMMAND", help=argparse.SUPPRESS)
    subparsers = {
        command.name: group.add_parser(
            command.name,
            prog=f"ins-robot {command.name}",
            description=command.summary[0].upper() + command.summary[1:] + ".",
            allow_abbrev=False,
        )
        for command in COMMANDS
    }
    return parser, subparsers


def _report(message: str) -> int:
    print("ins-robot: " + " ".join(message.split()), file=sys.stderr)
    return EXIT_ERROR
