# SPDX-License-Identifier: Apache-2.0
"""The mission of a planner: a list of way-points that the robot's own server drives."""

from __future__ import annotations

import asyncio
import contextlib
import math
import secrets
from collections.abc import Callable
from typing import Any

import regista
from regista import Pose2d, planner
from regista.asyncio import Device
from regista.planner import MissionState

from .mission import Point, State, check, to_dict

GROUP = "mission"
ACTIVE = (MissionState.driving, MissionState.working, MissionState.asking)
SETTLE_SECONDS = 1.0  # within which a planner takes up what it was told


class PlannerMission:
    """What the page calls `Mission`, driven by a planner: uploaded, started and watched from here.

    It shows what others uploaded, too. While ours is under way the gateway keeps it alive; whatever pauses it also
    gives the planner back.
    """

    def __init__(self, device: Device[Any], name: str) -> None:
        self.points: list[Point] = []
        self.alone = False
        self.state = State.PAUSED
        self.index = 0
        self.reason = ""
        self.owner = ""
        self._device, self._name = device, name
        self._id = ""
        self._told: MissionState | int = MissionState.none
        self._question = planner.GoOn()
        self._why: tuple[State, str] | None = None  # why we let it go
        self._cleared: str | None = None  # the id of what the page wants to see no more
        self._settled_at = 0.0
        self.changes = 0  # what was asked of the server before the last one counts no more

    @property
    def address(self) -> str:
        """Of the planner."""
        return self._device.address

    @property
    def ours(self) -> bool:
        return self.owner == self._name

    @property
    def accepted(self) -> bool:
        """The planner drives for us."""
        return self.ours and self._told in ACTIVE

    @property
    def drives(self) -> bool:
        """For us, or will as soon as it has heard so; asks for us, too."""
        return self.ours and self._under_way

    @property
    def _under_way(self) -> bool:
        return self.state is State.RUNNING or self._told in ACTIVE

    def step(self) -> bool:
        """The planner does that itself."""
        return False

    async def look(self, owner: str, why: str, changes: int) -> bool:
        """True: something changed. `owner` of the planner, and `why` it stands, as the server said after `changes`."""
        before = self.to_dict()
        mission = await self._device.request(planner.GetMission())
        path = None
        if mission.id != self._id or mission.count != len(self.points) or not mission.id:
            path = await self._device.request(planner.GetWaypoints())
        if changes != self.changes:
            return False
        if mission.id != self._id:
            self.alone, self._why = False, None
        if path is not None:
            self.points = [Point(p.x, p.y, p.heading) for p in path.waypoints]
            self._id = mission.id
        if mission.state is not MissionState.none and mission.id == self._cleared:
            self.points = []
        settling = asyncio.get_running_loop().time() < self._settled_at
        if settling and not owner:  # the server was asked before it had heard of our RUN
            owner = self._name
        self._told, self.owner, self.index = mission.state, owner, mission.point
        self._question = planner.GoOn(point=mission.point, action=mission.action)
        if settling and self._why is None and mission.state in (MissionState.ready, MissionState.paused):
            return self.to_dict() != before
        if mission.state in ACTIVE:
            self._why = None
        self.state, self.reason = self._standing(mission, why)
        if self.ours and self.state in (State.DONE, State.FAILED):
            self._why = (self.state, self.reason)
            await self._let_go()
        return self.to_dict() != before

    def _standing(self, mission: planner.Mission, why: str) -> tuple[State, str]:
        if mission.state is MissionState.asking:
            return State.PAUSED, f"point {mission.point + 1} asks; Resume is the answer"
        if mission.state is MissionState.working:
            return State.RUNNING, f"at work at point {mission.point + 1}"
        if mission.state is MissionState.driving:
            return State.RUNNING, ""
        if mission.state is MissionState.finished:
            return State.DONE, ""
        if mission.state is MissionState.failed:
            return State.FAILED, mission.reason
        if self._why is not None:
            return self._why
        if mission.state is MissionState.ready:
            return State.PAUSED, "uploaded, not started"
        return State.PAUSED, why or mission.reason

    async def go(self, points: list[Point], *, alone: bool, wanted: Callable[[], None]) -> None:
        """Upload and drive. A regista.RefusedError says why not; `wanted` raises when that is wanted no more."""
        check(points)
        self._check_owner()
        if self.drives:
            await self._let_go()
            wanted()
        id_ = f"{self._name} {secrets.token_hex(4)}"[-63:]
        await self._device.request(planner.SetMission(id=id_, points=self._poses(points), actions=[]))
        wanted()
        self._id, self.points, self.alone = id_, points, alone
        self._run()

    async def resume(self, *, alone: bool) -> None:
        """On with the way-point that was not reached; or what the point asks is answered."""
        self._check_owner()
        self.alone = alone
        if self._told is MissionState.asking:
            await self._device.request(self._question)
        else:
            self._run()

    def _run(self) -> None:
        self.changes += 1
        self._why = self._cleared = None
        self._device.send(planner.RunCommand(id=self._id))
        self._device.proxy.keep_alive(True)
        self._device.robot._watch()
        self.owner = self._name
        self.state, self.reason = State.RUNNING, ""
        self._settled_at = asyncio.get_running_loop().time() + SETTLE_SECONDS

    async def pause(self, reason: str) -> None:
        """The robot comes to rest; it goes on only when somebody says so."""
        if not self._under_way:
            return
        self._end(State.PAUSED, reason)
        try:
            if self.ours:
                self._device.proxy.keep_alive(False)
            with contextlib.suppress(regista.RefusedError):  # it is not under way
                await self._device.request(planner.Enable(on=0))
            if self.ours:
                await self._let_go()
        except regista.Error as error:
            self.reason = f"{reason}; {error}"

    def _end(self, state: State, reason: str) -> None:
        self.changes += 1
        self._told = MissionState.paused
        self.state, self.reason = self._why = state, reason

    def fail(self, reason: str, state: State = State.FAILED) -> None:
        """The server has stopped it, or never started."""
        if self._under_way:
            self._end(state, reason)
            with contextlib.suppress(regista.Error, ValueError, RuntimeError):  # closed, or being closed
                self._device.proxy.keep_alive(False)

    async def cancel(self) -> None:
        """Paused, and shown no more."""
        await self.pause("cancelled")
        self.changes += 1
        self._cleared = self._id
        self.points = []

    async def take(self, wanted: Callable[[], None]) -> None:
        """Away from whoever has it; it does not go on. `wanted` raises when that is wanted no more."""
        await self.pause("you took the controls")
        wanted()
        if self.owner and not self.ours:
            await self._device.take(GROUP)
            await self._let_go()

    async def _let_go(self) -> None:
        self.owner = ""
        await self._device.release(GROUP)

    def _check_owner(self) -> None:
        if self.owner and not self.ours:
            raise ValueError(f"{self.owner} drives {self.address}: take over first")

    def _poses(self, points: list[Point]) -> list[Pose2d]:
        """A point without heading is left towards the next one; the last one, in the direction it was reached from."""
        here = self._device.latest(planner.State).value
        places = [(here.pose.x, here.pose.y), *((p.x, p.y) for p in points)]
        poses = []
        for i, point in enumerate(points):
            (x1, y1), (x2, y2) = places[i + 1 : i + 3] if i + 1 < len(points) else places[i : i + 2]
            heading = point.heading if point.heading is not None else math.atan2(y2 - y1, x2 - x1)
            poses.append(Pose2d(point.x, point.y, heading))
        return poses

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        return to_dict(self)
