# SPDX-License-Identifier: MIT
"""What people ask of a run that drives, kept until its method can take it up."""

from __future__ import annotations

import asyncio

from ins_robot.errors import StateError

Place = tuple[float, float]


class Orders:
    """At most one place to go to, and whether the zones have changed."""

    def __init__(self) -> None:
        self.zones_changed = False
        self._place: tuple[Place, asyncio.Future[None]] | None = None

    @property
    def are_waiting(self) -> bool:
        """Something is to be taken up."""
        return self.zones_changed or self._place is not None

    async def go_to(self, place_m: Place) -> None:
        """Ask for a place; returns when the robot sets out; StateError: why it does not."""
        if self._place is not None:
            raise StateError("goto: another place is just being looked at; ask again")
        done = asyncio.get_running_loop().create_future()
        self._place = place_m, done
        await done

    def take_place(self) -> tuple[Place, asyncio.Future[None]] | None:
        """The place asked for, once; its future is to be told."""
        taken, self._place = self._place, None
        return taken

    def refuse(self, why: str) -> None:
        """Nothing will be taken up any more."""
        taken = self.take_place()
        if taken is not None:
            answer(taken[1], StateError(why))


def answer(done: asyncio.Future[None], error: Exception | None) -> None:
    """Tell who asked, once; they may have gone."""
    if done.done():
        return
    if error is None:
        done.set_result(None)
    else:
        done.set_exception(error)
