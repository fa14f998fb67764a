# SPDX-License-Identifier: MIT
"""Where the pose may have drifted by the clearance there is, a sweep is waited for standing."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from ins_robot.daemon.mission import Mission


@pytest.mark.parametrize("may_touch", [False, True])
@pytest.mark.parametrize("is_paused", [False, True])
def test_a_robot_that_may_touch_stands_until_it_has_looked(may_touch, is_paused):
    pilot = SimpleNamespace(is_held=is_paused)
    held = []

    async def sweep():
        held.append(pilot.is_held)

    mission = SimpleNamespace(
        _pilot=pilot, is_paused=is_paused, _may_touch=lambda: may_touch, _sweep=sweep
    )
    asyncio.run(Mission._sweep_on_the_way(mission))
    assert held == [may_touch or is_paused]
    assert pilot.is_held is is_paused
