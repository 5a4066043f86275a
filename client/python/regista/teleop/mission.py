# SPDX-License-Identifier: Apache-2.0
"""A list of way-points that a base drives along, one after the other."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import regista
from regista import _core
from regista.asyncio import Position2d


class State(StrEnum):
    RUNNING = "running"
    PAUSED = "paused"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class Point:
    """x, y [m] and heading [rad] in the base's frame; without heading, any will do."""

    x: float
    y: float
    heading: float | None = None


MOST_POINTS = 1000


def check(points: list[Point]) -> None:
    """ValueError when that is no list of way-points."""
    if not 0 < len(points) <= MOST_POINTS:
        raise ValueError(f"a mission has 1 to {MOST_POINTS} way-points, not {len(points)}")


class Shown(Protocol):
    """What the page sees of a mission."""

    points: list[Point]
    index: int
    state: State
    reason: str
    alone: bool


def to_dict(mission: Shown) -> dict[str, Any]:
    """For the page."""
    points = [(p.x, p.y, p.heading) for p in mission.points]
    return {
        "points": points, "index": mission.index, "state": mission.state, "reason": mission.reason,
        "alone": mission.alone,
    }  # fmt: skip


class Mission:
    """Drives; `step()` often. While it runs the base has a destination, kept alive by the gateway's event loop.

    Args:
        base: What drives.
        points: At least one.
        alone: Goes on when no page is there to watch.
    """

    NEAR = 0.15  # m: so near to a point on the way, the next one is due
    THERE = (0.05, 0.1)  # m, rad: of the last one
    ours = True  # nobody else knows of it

    def __init__(self, base: Position2d, points: list[Point], *, alone: bool) -> None:
        check(points)
        self.points = points
        self.alone = alone
        self.state = State.RUNNING
        self.index = 0
        self.reason = ""
        self.accepted = False  # the base drives for us
        self._base = base
        self._follower: Any = None

    def step(self) -> bool:
        """True: something changed, which the page should be told."""
        if self.state is not State.RUNNING:
            return False
        try:
            if self._follower is None:
                self._follower = self._to(self.index)
            if not self._follower.step():
                return False
            self.index += 1
            self._follower = None
            if self.index == len(self.points):
                self.state = State.DONE
                self._base.proxy.keep_alive(False)
            else:
                self._follower = self._to(self.index)
                self._follower.step()
            return True
        except regista.Error as error:
            self.fail(error.reason or str(error))
            return True
        finally:
            self._base.robot._watch()

    @property
    def drives(self) -> bool:
        return self.state is State.RUNNING

    async def resume(self, *, alone: bool) -> None:
        """On with the way-point that was not reached."""
        if self.state in (State.PAUSED, State.FAILED):
            self.alone = alone
            self.state, self.reason = State.RUNNING, ""
            self.accepted = False

    async def pause(self, reason: str) -> None:
        """The base comes to rest; it goes on only when somebody says so."""
        if self.state is not State.RUNNING:
            return
        self.state, self.reason = State.PAUSED, reason
        self._follower = None
        try:
            self._base.set_velocity()  # at once; the question may have to wait for another's answer
            await self._base.stop()
        except regista.Error as error:
            self.reason = f"{reason}; {error}"

    def fail(self, reason: str, state: State = State.FAILED) -> None:
        """The base has been stopped, or never started; if it drives after all, its lease ends that."""
        if self.state is State.RUNNING:
            self.state, self.reason = state, reason
            self._follower = None
            with contextlib.suppress(regista.Error, ValueError, RuntimeError):  # closed, or being closed
                self._base.proxy.keep_alive(False)

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        return to_dict(self)

    def _to(self, index: int) -> Any:
        point, last = self.points[index], index + 1 == len(self.points)
        if point.heading is not None:
            heading = point.heading
        elif last:
            heading = self._base.state.pose.heading
        else:
            heading = math.atan2(self.points[index + 1].y - point.y, self.points[index + 1].x - point.x)
        distance, turn = self.THERE if last else (self.NEAR, math.pi)
        if point.heading is None:
            turn = math.pi
        return _core.Follower(self._base.proxy._core, [(point.x, point.y, heading)], (distance, turn))
