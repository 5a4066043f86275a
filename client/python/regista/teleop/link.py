# SPDX-License-Identifier: Apache-2.0
"""One robot, as the gateway knows it: connected again and again, its newest values, and what it is told to do."""

from __future__ import annotations

import asyncio
import contextlib
import math
import operator
import time
from collections.abc import Callable
from typing import Any, cast

import regista
import regista.asyncio
from regista import dio, kicker, planner, position2d, recording
from regista.message import Data

from . import fields
from .hand import Hand
from .mission import Mission, Point, State
from .planned import GROUP, PlannerMission

Tell = Callable[[dict[str, Any]], None]

# What a page can show. Opening a device may start hardware: others stay closed.
SHOWN = (
    "position2d",
    "position1d",
    "power",
    "kicker",
    "imu",
    "gps",
    "dio",
    "aio",
    "actarray",
    "localize",
    "planner",
)
STATUS_SECONDS = 0.2
REST_SECONDS = 0.5 + 2 * STATUS_SECONDS  # a lease, and what we learn late
RETRY_SECONDS = (0.2, 0.5, 1.0, 2.0)
RECORD_LIMIT = 10_000  # messages between two looks
PEOPLE = 20  # the priority of what a person does by hand


class Stream:
    """One kind of message of one device: a row of numbers."""

    def __init__(self, device: regista.asyncio.Device[Any], kind: type[Data]) -> None:
        self.address = device.address
        self.name = kind.NAME
        self.paths, self._values = fields.numbers(kind)
        self._device, self._kind = device, kind
        self._count = 0

    def news(self, now: float, *, again: bool) -> list[float | None] | None:
        """Its age [s] and its numbers, when there are new ones, or `again`. What is no number is None."""
        sample = self._device.latest(self._kind)
        if sample.count == 0 or (sample.count == self._count and not again):
            return None
        self._count = sample.count
        row = (now - sample.arrival, *self._values(sample.value))
        if all(map(math.isfinite, row)):
            return [round(value, 6) for value in row]
        return [round(value, 6) if math.isfinite(value) else None for value in row]


class Link:
    """Runs until it is cancelled. What it has to say goes to `tell`, as the page understands it (docs/teleop.md)."""

    def __init__(
        self, number: int, label: str, host: str, port: int, name: str, tell: Tell, live: recording.Log | None = None
    ) -> None:
        self.number = number
        self.label = label
        self.name = name
        self.streams: list[Stream] = []
        self.state: dict[str, Any] = {}  # what a page that comes later has to know
        self._log: recording.Log | None = None  # while it is recorded
        self._live = live  # gets everything, always
        self._host, self._port = host, port
        self._tell_all = tell
        self._robot: regista.asyncio.Robot | None = None
        self._opening: regista.asyncio.Robot | None = None  # connected, and perhaps not yet ready
        self._hands: dict[str, Hand] = {}
        self._missions: dict[str, Mission | PlannerMission] = {}  # by the base or the planner that drives
        self._revoked = (0, "")  # how often what was asked, and not done yet, was wanted no more; why
        self._leaving: asyncio.Task[None] | None = None
        self._grabbing: asyncio.Task[None] | None = None  # a base from its planner
        self._grab_held = False  # who grabs has not let go
        self._stopping_at = -math.inf  # when a device was last told to stop, or seen on its way to rest [s]
        self._look = asyncio.Event()
        self._seen: str | None = None
        self._localizer: str | None = None
        self._tell("robot", label=label, connected=False, why="connecting", devices=[], streams=[])

    async def run(self) -> None:
        tries = 0
        while True:
            try:
                # So short that a dead server is seen soon, so long that a busy one is not taken for dead.
                robot = regista.asyncio.Robot(self._host, self._port, timeout=1.5, name=self.name, priority=PEOPLE)
                async with robot:
                    tries = 0
                    self._opening = robot
                    try:
                        await self._serve(robot)
                    finally:  # closing takes a while, in another thread
                        self._robot = self._opening = None
                        self.streams = []
            except (regista.Error, OSError) as error:
                self._lost(str(error))
            except Exception as error:  # it says what we do not understand
                self._lost(repr(error))
            await asyncio.sleep(RETRY_SECONDS[min(tries, len(RETRY_SECONDS) - 1)])
            tries += 1

    async def _serve(self, robot: regista.asyncio.Robot) -> None:
        streams: list[Stream] = []
        devices = []
        infos = await robot.devices()
        for info in infos:
            interface = info.address.partition(":")[0]
            if interface not in SHOWN:
                continue
            device: dict[str, Any] = {"address": info.address, "driver": info.driver}
            devices.append(device)
            try:
                proxy = await robot.device(info.address)
            except regista.RefusedError as error:
                device["trouble"] = error.reason or str(error)
                continue
            streams += [Stream(proxy, kind) for kind in fields.data_kinds(interface)]
            if interface == "planner":
                try:
                    await proxy.request(planner.GetMission())
                except regista.RefusedError as error:
                    if "does not answer this request" in error.reason:
                        device["trouble"] = "it takes no lists of way-points"
                if "trouble" not in device:
                    self._missions[info.address] = PlannerMission(proxy, self.name)
            with contextlib.suppress(regista.RefusedError):  # not every driver tells how large it is
                if isinstance(proxy, regista.asyncio.Position2d):
                    size = (await proxy.geometry()).size
                    device["size"] = [size.length, size.width]
                elif interface == "kicker":
                    device["limits"] = (await proxy.request(kicker.GetLimits())).to_dict()
        bases = [
            info.address for info in infos if info.driver == "ssl_robot" and info.address.startswith("position2d:")
        ]
        self._seen = bases[0] if bases else None
        self._localizer = next(
            (i.address for i in infos if (i.driver, i.address[:11]) == ("localizer", "position2d:")), None
        )
        self._robot = robot
        self.streams = streams
        described = [{"device": s.address, "name": s.name, "paths": s.paths} for s in streams]
        self._tell(
            "robot", label=self.label, connected=True, why="", devices=devices, streams=described,
            extended=robot.extended,
        )  # fmt: skip
        await self._begin_record(robot)
        while True:
            await self._status(robot)
            self._look.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._look.wait(), STATUS_SECONDS)

    async def _status(self, robot: regista.asyncio.Robot) -> None:
        """Who drives, the beats, and how long the question took."""
        asked = time.monotonic()
        changes = {planned.address: planned.changes for planned in self._planned()}
        if not robot.extended:  # a stock server: any question tells whether it is there
            await robot.devices()
            self._tell("status", round_trip_s=time.monotonic() - asked, drivers=[])
            return
        status = await robot.status()
        round_trip = time.monotonic() - asked
        vision, place = [await self._say(robot, *one) for one in ((self._seen, "vision"), (self._localizer, "status"))]
        self._tell("status", round_trip_s=round_trip, drivers=status["drivers"], vision=vision, place=place)
        for driver in status["drivers"]:
            for device in driver["devices"]:
                for motion in device["motion"]:
                    if motion["state"] == "stopping":
                        self._stopping_at = time.monotonic()
                    await self._watch_mission(device["device"], motion, changes)

    async def _say(self, robot: regista.asyncio.Robot, device: str | None, key: str) -> str:
        """What ssl_robot thinks of its camera: good, stale, lost …; what localizer thinks of its sensors."""
        if device is None:
            return ""
        try:
            return await robot._devices[device].property(key, str)
        except (regista.RefusedError, KeyError):
            return ""

    async def _watch_mission(self, address: str, motion: dict[str, Any], changes: dict[str, int]) -> None:
        """A destination that the base did not take up has failed, and says why; a planner is asked how far it is."""
        mission = self._missions.get(address)
        if isinstance(mission, PlannerMission):
            if motion["group"] != GROUP:
                return
            try:
                changed = await mission.look(motion["owner"], motion["reason"], changes[address])
            except (regista.RefusedError, regista.TimeoutError) as error:  # what it said last counts until it answers
                changed = mission.reason != str(error)
                mission.reason = str(error)
            if changed:
                self._tell_mission(address)
            return
        if mission is None or mission.state is not State.RUNNING or motion["group"] != "motion":
            return
        if motion["owner"] and motion["owner"] != self.name:
            mission.fail(f"{motion['owner']} drives")
            self._tell_mission(address)
        mission.accepted |= motion["owner"] == self.name and motion["state"] == "driving"

    def _lost(self, why: str) -> None:
        self._robot = None
        self.streams = []
        self._hands.clear()
        for address, mission in self._missions.items():
            mission.fail("the connection was lost")
            self._tell_mission(address)
        self._missions.clear()
        self._tell("robot", label=self.label, connected=False, why=why, devices=[], streams=[])

    def _tell(self, type_: str, *, keep: str = "", **values: Any) -> None:
        message = {"t": type_, "robot": self.number, **values}
        self.state[keep or type_] = message
        self._tell_all(message)

    def _tell_mission(self, address: str) -> None:
        """Unless it has gone meanwhile, with the connection."""
        mission = self._missions.get(address)
        if mission is not None:
            self._tell("mission", keep=f"mission {address}", device=address, **mission.to_dict())

    def note(self, text: str, severity: int = 1) -> None:
        """For whoever reads what happened. `severity`: 2 is bad."""
        self._tell_all({"t": "event", "robot": self.number, "severity": severity, "text": text})

    # Sixty times a second

    def tick(self, *, watched: bool) -> None:
        """Step missions, and pass on what happened. `watched`: whoever has the controls sees the page."""
        if self._robot is None:
            return
        if not watched and self._unwatched() and (self._leaving is None or self._leaving.done()):
            self._leaving = asyncio.get_running_loop().create_task(self.page_gone("nobody watches"))
        for address, mission in self._missions.items():
            hand = self._hands.get(address)
            if (hand is None or hand.settled) and mission.step():
                self._tell_mission(address)
                self._look.set()
        for event in self._robot.events():
            self.note(event.text, event.severity)
            for address, mission in self._missions.items():
                # Everybody hears of every refusal: when the base drives for us, it was another's.
                if mission.ours and not mission.accepted and event.text.startswith(f"{address} refused: "):
                    mission.fail(event.text)
                    self._tell_mission(address)
            self._look.set()
            self._write(operator.methodcaller("event", event))
        if self._logs():
            for received in self._robot.messages():
                self._write(operator.methodcaller("data", received))

    def _write(self, put: Callable[[recording.Log], None]) -> None:
        """A log that fails gets no more: driving does not depend on it."""
        for log in self._logs():
            try:
                put(log)
            except Exception as error:
                what = "Foxglove" if log is self._live else "recording"
                self._live = None if log is self._live else self._live
                self._log = None if log is self._log else self._log
                self.note(f"{what} of {self.label} ended: {error!r}")

    def news(self, now: float, *, again: bool = False) -> list[list[Any]]:
        """Of each stream that has news: its number, age and values."""
        found: list[list[Any]] = []
        for number, stream in enumerate(self.streams):
            row = stream.news(now, again=again)
            if row is not None:
                found.append([number, *row])
        return found

    # What the page asks for. A regista.Error says why not.

    def hold(self, device: str, velocity: Any) -> None:
        """Drive by hand; a mission of the same base pauses, and resumes only when somebody says so."""
        self._grab_held = True
        if self._grabs:
            return
        for address, mission in self._missions.items():
            if isinstance(mission, PlannerMission):
                if mission.drives:
                    self._grabbing = asyncio.get_running_loop().create_task(self._grab(mission, device))
                    return
            elif address == device and mission.state is State.RUNNING:
                mission.fail("you took the controls", State.PAUSED)
                self._tell_mission(address)
        if device not in self._hands:
            self._hands[device] = Hand(self._base(device))
        self._hands[device].hold(velocity)

    async def _grab(self, mission: PlannerMission, base: str) -> None:
        """What a planner of ours drives is taken from it; whoever lets go meanwhile leaves a base that stands."""
        wanted = self._ask()
        try:
            await mission.pause("you took the controls")
            self._tell_mission(mission.address)
            wanted()
            await self._base(base).take()
        except (regista.Error, ValueError) as error:
            self.note(str(error))

    @property
    def _grabs(self) -> bool:
        return self._grabbing is not None and not self._grabbing.done()

    @property
    def held(self) -> bool:
        """By hand, or about to be."""
        return any(hand.held for hand in self._hands.values()) or (self._grabs and self._grab_held)

    def let_go(self) -> None:
        """Of everything that is held by hand."""
        self._grab_held = False
        for hand in self._hands.values():
            hand.let_go()

    def _ask(self) -> Callable[[], None]:
        """To be called after each wait, before anything moves: raises ValueError when that is wanted no more."""
        asked, _ = self._revoked

        def wanted() -> None:
            revoked, reason = self._revoked
            if revoked != asked:
                raise ValueError(f"{self.label} was not started: {reason}")

        return wanted

    def _revoke(self, reason: str) -> None:
        self._revoked = (self._revoked[0] + 1, reason)

    async def _settle(self, device: str) -> None:
        if device in self._hands:
            await self._hands[device].settle()

    async def page_gone(self, reason: str) -> None:
        """Nobody watches: zero at once, and missions pause that may not go on alone."""
        self._revoke(reason)
        self.let_go()
        for mission in self._unwatched():
            await mission.pause(reason)
            for address in [address for address, one in self._missions.items() if one is mission]:
                self._tell_mission(address)

    def _unwatched(self) -> list[Mission | PlannerMission]:
        """What drives for us and may not without somebody who watches."""
        return [mission for mission in self._missions.values() if mission.drives and not mission.alone]

    async def close(self) -> None:
        """At rest and given back."""
        if self._robot is None:
            return
        await self.page_gone("regista teleop ended")
        for hand in self._hands.values():
            await hand.settle()

    async def stop(self) -> None:
        """Every device to rest, whoever drives it, at once: whatever else the robot has been asked."""
        self._revoke("STOP")
        self.let_go()
        self._stopping_at = time.monotonic()
        robot = self._opening or self._connected()
        for address, mission in self._missions.items():
            mission.fail("STOP", State.PAUSED)
            self._tell_mission(address)
        await robot.stop()
        self._look.set()

    async def take(self, device: str) -> None:
        wanted = self._ask()
        await self._settle(device)
        for planned in self._planned():
            wanted()
            await planned.take(wanted)
            self._tell_mission(planned.address)
        base = await self._device(device)
        wanted()
        await base.take()
        self._look.set()

    async def give(self, device: str) -> None:
        self._revoke("you gave the robot back")
        self.let_go()
        await self._settle(device)
        for planned in self._planned():
            if planned.ours:
                await planned.pause("you gave the robot back")
                self._tell_mission(planned.address)
        await (await self._device(device)).release()
        self._look.set()

    async def go(self, device: str, points: list[Point], *, alone: bool) -> None:
        """`device`: the planner; of a robot without one, the base."""
        self._revoke("another destination was given")
        wanted = self._ask()
        self.let_go()
        planned = self._missions.get(device)
        if isinstance(planned, PlannerMission):
            await self._rest()
            wanted()
            await planned.go(points, alone=alone, wanted=wanted)
        else:
            self._missions[device] = Mission(self._base(device), points, alone=alone)
        self._tell_mission(device)
        self._look.set()

    async def pause(self, device: str) -> None:
        self._revoke("you paused it")
        if device in self._missions:
            await self._missions[device].pause("you paused it")
            self._tell_mission(device)

    async def resume(self, device: str, *, alone: bool) -> None:
        wanted = self._ask()
        mission = self._missions.get(device)
        if mission is None:
            raise ValueError("that list of way-points is gone: start it again")
        self.let_go()
        if isinstance(mission, PlannerMission):
            await self._rest()
            wanted()
        await mission.resume(alone=alone)
        self._tell_mission(device)
        self._look.set()

    async def cancel(self, device: str) -> None:
        self._revoke("cancelled")
        mission = self._missions.get(device)
        if isinstance(mission, PlannerMission):
            await mission.cancel()
            self._tell_mission(device)
        elif mission is not None:
            del self._missions[device]
            await mission.pause("cancelled")
            self.state.pop(f"mission {device}", None)
            self._tell_all({"t": "mission", "robot": self.number, "device": device, "points": []})

    async def motors(self, device: str, on: bool) -> None:
        await self._base(device).request(position2d.SetMotorPower(on=int(on)))

    async def odometry(self, device: str, x: float, y: float, heading: float) -> None:
        await self._base(device).set_odometry(x, y, heading)

    async def kick(self, device: str, action: str, speed: float, angle: float) -> None:
        """`action`: kick or chip [m/s, rad], dribble [rad/s], charge [0, 1]."""
        proxy = cast(regista.Kicker, (await self._device(device)).proxy)
        if action == "kick":
            proxy.kick(speed)
        elif action == "chip":
            proxy.chip(speed, angle)
        elif action == "dribble":
            proxy.dribble(speed)
        elif action == "charge":
            proxy.charge(bool(speed))
        else:
            raise ValueError(f"a kicker does not {action}")

    async def outputs(self, device: str, count: int, bits: int) -> None:
        (await self._device(device)).send(dio.OutputCommand(count=count, bits=bits))

    async def record(self, log: recording.Log | None) -> None:
        """From now on, everything; None: no more. It goes on after the connection was lost and is there again."""
        self._log = log
        if self._robot is not None:
            await self._begin_record(self._robot)

    def _logs(self) -> list[recording.Log]:
        return [log for log in (self._log, self._live) if log is not None]

    async def _begin_record(self, robot: regista.asyncio.Robot) -> None:
        robot.record(RECORD_LIMIT if self._logs() else 0)
        for address, device in list(robot._devices.items()) if self._log is not None else []:
            for request in recording.descriptions(address.partition(":")[0]):
                with contextlib.suppress(regista.RefusedError):
                    answer = await device.request(request)
                    if self._log is not None:
                        self._log.answer(address, request, answer)

    def _connected(self) -> regista.asyncio.Robot:
        if self._robot is None:
            raise regista.ConnectionError(f"{self.label} is not connected")
        return self._robot

    async def _rest(self) -> None:
        """What was stopped takes commands again from whoever paused for a lease: a planner does not, it drives on."""
        while (left := self._stopping_at + REST_SECONDS - time.monotonic()) > 0:
            await asyncio.sleep(left)

    def _planned(self) -> list[PlannerMission]:
        return [mission for mission in self._missions.values() if isinstance(mission, PlannerMission)]

    def _base(self, address: str) -> regista.asyncio.Position2d:
        device = self._connected()._devices.get(address)
        if not isinstance(device, regista.asyncio.Position2d):
            raise ValueError(f"{self.label} has no base {address}")
        return device

    async def _device(self, address: str) -> regista.asyncio.Device[Any]:
        if address.partition(":")[0] not in SHOWN:
            raise ValueError(f"{address} is not driven from here")
        return await self._connected().device(address)
