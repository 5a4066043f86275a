# SPDX-License-Identifier: Apache-2.0
"""Driving by hand: what a page holds, on its way to the base."""

from __future__ import annotations

import asyncio
import contextlib

import regista
from regista.asyncio import Position2d
from regista.cli.hand import DeadMan, Release, Velocity


class Hand:
    """Sends what the page holds: at most 50 commands a second, the newest wins.

    A page that says nothing for `PATIENCE` has let go, long before the server's lease ends. Letting go is zero three
    times, the base given back, and silence.
    """

    PATIENCE = 0.15  # s: a page says what it holds every 25 ms

    def __init__(self, base: Position2d) -> None:
        self._base = base
        self._dead_man = DeadMan()
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._settled = asyncio.Event()  # clear: let go, and not yet given back
        self._settled.set()
        self._releases: set[asyncio.Task[None]] = set()

    @property
    def held(self) -> bool:
        return self._dead_man.held

    def hold(self, velocity: Velocity) -> None:
        self._dead_man.hold(velocity, self._loop.time() + self.PATIENCE)
        self._settled.set()
        self._step()

    def let_go(self) -> None:
        """Zero at once; does nothing when nothing is held."""
        self._dead_man.let_go()
        self._step()

    @property
    def settled(self) -> bool:
        """False: what was let go has not been given back yet. What is taken or driven now would be lost by that."""
        return self._settled.is_set()

    async def settle(self) -> None:
        """Until what was let go has been given back, or is held again."""
        await self._settled.wait()

    def _step(self) -> None:
        try:
            while (action := self._dead_man.step(self._loop.time())) is not None:
                if isinstance(action, Release):
                    task = self._loop.create_task(self._release())
                    self._releases.add(task)
                    task.add_done_callback(self._releases.discard)
                else:
                    self._base.set_velocity(action.x, action.y, action.w)
        except (regista.Error, ValueError, RuntimeError):  # no connection: the server stops what its client left
            self._dead_man = DeadMan()
            self._settled.set()
        if self._dead_man.active and not self._dead_man.held:
            self._settled.clear()
        if self._timer is not None:
            self._timer.cancel()
        due = self._dead_man.due()
        self._timer = self._loop.call_at(due, self._step) if due < float("inf") else None

    async def _release(self) -> None:
        if not self._dead_man.active:  # grabbed again meanwhile
            with contextlib.suppress(regista.Error, ValueError, RuntimeError):
                await self._base.release()
        if not self._dead_man.active:
            self._settled.set()
