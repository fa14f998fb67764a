# SPDX-License-Identifier: MIT
"""On the way a sweep is waited for standing where the pose may have drifted by the clearance.

And where it was far from where the motion had led, the robot stands to hear its gyro.
"""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from ins_robot.daemon import mission as mission_module
from ins_robot.daemon.mission import Mission


class Sweeping(Mission):
    """A mission of which only the sweep on the way is there."""

    def __init__(self, may_touch, meanwhile, was_astray=False):
        slam = SimpleNamespace(was_astray=was_astray)
        self.core = SimpleNamespace(survey=SimpleNamespace(slam=slam))
        self._pilot = SimpleNamespace(is_held=False)
        self._go = asyncio.Event()
        self._go.set()
        self._pauses_s, self._clock = [], lambda: 0.0
        self._is_looking = self._stands_to_look = False
        self._may_touch = lambda: may_touch
        self._meanwhile = meanwhile
        self.held = []

    async def _sweep(self):
        self._meanwhile(self)
        self.held.append(self._pilot.is_held)

    async def look(self):
        await self._sweep_on_the_way()
        self.held.append(self._pilot.is_held)


def held(may_touch, meanwhile):
    """Whether the wheels are held during the sweep, and after it."""

    async def live():
        mission = Sweeping(may_touch, meanwhile)
        await mission.look()
        return mission.held

    return asyncio.run(live())


@pytest.mark.parametrize("may_touch", [False, True])
def test_a_robot_that_may_touch_stands_until_it_has_looked(may_touch):
    assert held(may_touch, lambda mission: None) == [may_touch, False]


def test_a_robot_that_comes_near_while_it_looks_stops_there():
    def drives_on(mission):
        assert not mission._pilot.is_held
        mission._may_touch = lambda: True
        mission._mind_the_wall()  # as with every telemetry frame

    assert held(False, drives_on) == [True, False]


@pytest.mark.parametrize("may_touch", [False, True])
def test_a_pause_in_between_lasts(may_touch):
    assert held(may_touch, lambda mission: mission.pause()) == [True, True]


@pytest.mark.parametrize("may_touch", [False, True])
def test_resuming_in_between_does_not_end_the_look(may_touch):
    def paused_for_a_moment(mission):
        mission.pause()
        mission.resume()

    assert held(may_touch, paused_for_a_moment) == [may_touch, False]


def test_after_a_scan_far_from_where_the_motion_led_it_stands_to_listen_to_its_gyro(
    monkeypatch,
):
    monkeypatch.setattr(mission_module, "GYRO_REST_S", 0.05)

    async def live():
        mission = Sweeping(False, lambda mission: None, was_astray=True)
        looking = asyncio.create_task(mission.look())
        await asyncio.sleep(0.01)
        is_held = mission._pilot.is_held
        await looking
        return is_held, mission._pilot.is_held

    assert asyncio.run(live()) == (True, False)
