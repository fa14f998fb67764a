# SPDX-License-Identifier: MIT
"""Zones are written beside the event loop, one change after the other; refusals teach."""

import asyncio
import os
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from ins_robot.daemon import commands
from ins_robot.daemon.after_run import AfterRun
from ins_robot.daemon.commands import DaemonCommands
from ins_robot.daemon.run_store import RunStore
from ins_robot.daemon.supervisor import StopLatch
from ins_robot.daemon.zone_store import read_zones
from ins_robot.errors import StateError
from ins_robot.mapping.zones import zone_of


def test_the_loop_does_not_wait_for_the_disk_and_no_change_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    syncing, checking, forbidden, sync = [], [], [], os.fsync

    def watched(file: int) -> None:
        syncing.append(threading.get_ident())
        sync(file)

    def checked(zone):
        checking.append(threading.get_ident())
        return zone_of(zone)

    monkeypatch.setattr(os, "fsync", watched)
    monkeypatch.setattr(commands, "zone_of", checked)  # hundreds of corners take their time

    async def forbid(zones) -> None:
        forbidden.append([zone.name for zone in zones])

    async def live() -> None:
        daemon = DaemonCommands(SimpleNamespace(forbid=forbid), RunStore(tmp_path))
        corners = [[1, 1], [2, 1], [1, 2]]
        zones = [{"name": name, "kind": "no-go", "points": corners} for name in "abcdefgh"]
        await asyncio.gather(*map(daemon.add_zone, zones))
        await daemon.remove_zone("b")

    asyncio.run(live())
    assert len(syncing) == 9
    assert len(checking) == 8
    assert threading.get_ident() not in [*syncing, *checking]
    kept = [zone.name for zone in read_zones(tmp_path / "zones.json")]
    assert sorted(kept) == list("acdefgh")
    assert forbidden[-1] == kept


@pytest.mark.parametrize(
    ("mission", "order", "says"),
    [
        (
            None,
            lambda at: at.goto(1.0, 2.0),
            "stopped: bumper; `ins-robot clear` releases it, ",
        ),
        (None, lambda at: at.map("png"), r"run '0001-lab' was interrupted; `ins-robot replay "),
        (object.__new__(AfterRun), lambda at: at.start(""), "a drive by goto is under way"),
    ],
)
def test_a_refusal_says_what_to_do(mission, order, says: str, tmp_path: Path) -> None:
    store = RunStore(tmp_path)
    store.create("lab")
    robot = SimpleNamespace(mission=mission, stop_latch=StopLatch("bumper"))
    with pytest.raises(StateError, match=says):
        asyncio.run(order(DaemonCommands(robot, store)))
