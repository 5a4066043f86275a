# SPDX-License-Identifier: Apache-2.0
"""Robots in an event loop:

    import regista.asyncio

    async with regista.asyncio.Robot("localhost") as robot:
        base = await robot.position2d()
        async for state in base:            # each state that comes
            if state.pose.x >= 1.0:
                break
            base.set_velocity(x=0.3)        # repeated: silence stops the robot
        await base.stop()

What has to wait is awaited; what only sends or looks is called. The loop watches the robot's socket: there is no
thread, but for the moments of connecting and closing. Commands and values come while others wait; of requests there is
one after the other, but `stop()` waits for none of them.
"""

from __future__ import annotations

import asyncio
import builtins
import functools
import json
import select
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from types import TracebackType
from typing import Any, Generic, Literal, Self, TypeVar, cast, overload

import regista
from regista import _core, player, position2d
from regista.errors import RefusedError
from regista.geometry import Pose2d
from regista.message import Command, Data, Received, Request, Sample
from regista.robot import PROPERTY_TYPES, DeviceInfo, not_there, to_path

D = TypeVar("D", bound=Data)
P = TypeVar("P", int, float, bool, str)
R = TypeVar("R")
X = TypeVar("X", bound=regista.Device)

_Reply = Callable[[Any, Exception | None], object]


class Robot:
    """As `regista.Robot`, whose arguments it has; connects when entered, and belongs to that event loop."""

    def __init__(
        self,
        host: str = "localhost",
        port: int = 6665,
        *,
        timeout: float = 2.0,
        name: str = "",
        priority: int = 10,
        mode: Literal["push", "pull"] = "push",
        reconnect: bool = False,
    ) -> None:
        self._connect = functools.partial(
            regista.Robot,
            host,
            port,
            timeout=timeout,
            name=name,
            priority=priority,
            mode=mode,
            reconnect=reconnect,
        )
        self._devices: dict[str, Device[Any]] = {}
        self._asking, self._stopping = asyncio.Lock(), asyncio.Lock()
        self._watched: tuple[int, int] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._failure: Exception | None = None

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._news: asyncio.Future[None] = self._loop.create_future()
        self._robot = await self._loop.run_in_executor(None, self._connect)
        self._watch()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._unwatch()
        self._end(ValueError("this robot is closed"))
        await self._loop.run_in_executor(None, self._robot.close)

    # Devices; the first use subscribes.

    async def position2d(self, index: int = 0) -> Position2d:
        """A base that moves in the plane."""
        return cast(Position2d, await self.device(f"position2d:{index}"))

    async def power(self, index: int = 0) -> Device[regista.Power]:
        """Battery or supply."""
        return await self.device(f"power:{index}")

    async def kicker(self, index: int = 0) -> Device[regista.Kicker]:
        """Kicker and dribbler of a soccer robot."""
        return await self.device(f"kicker:{index}")

    async def imu(self, index: int = 0) -> Device[regista.Imu]:
        """Inertial measurement unit."""
        return await self.device(f"imu:{index}")

    async def gps(self, index: int = 0) -> Device[regista.Gps]:
        """Satellite receiver."""
        return await self.device(f"gps:{index}")

    async def dio(self, index: int = 0) -> Device[regista.Dio]:
        """Digital inputs and outputs."""
        return await self.device(f"dio:{index}")

    async def opaque(self, index: int = 0) -> Device[regista.Opaque]:
        """Bytes that only the driver and its client understand."""
        return await self.device(f"opaque:{index}")

    async def device(self, address: str) -> Device[Any]:
        """A device of any interface: "actarray:0"."""
        interface, _, index = address.partition(":")
        address = f"{interface}:{index or 0}"
        async with self._asking:
            if address not in self._devices:
                await self._answer(functools.partial(self._robot._core.open, address))
                proxy = self._robot.device(address)
                if isinstance(proxy, regista.Position2d):
                    self._devices[address] = Position2d(self, proxy)
                else:
                    self._devices[address] = Device(self, proxy)
        return self._devices[address]

    async def devices(self) -> list[DeviceInfo]:
        """All devices of the server."""
        list_ = await self._ask(player.GetDeviceList())
        infos = [await self._ask(player.GetDriverInfo(address=address)) for address in list_.devices]
        names = [_core.device_name(info.address.interface, info.address.index) for info in infos]
        return [DeviceInfo(name, info.driver) for name, info in zip(names, infos, strict=True)]

    async def read(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] until data come. False: none came in time."""
        try:
            await asyncio.wait_for(self._next(), timeout)
        except builtins.TimeoutError as error:
            if isinstance(error, regista.Error):
                raise
            return False
        return True

    async def stop(self) -> None:
        """Bring every device to rest, whoever drives it. On a stock server: the position2d devices in use.

        Goes out at once, also while a driver owes another request its answer.
        """
        if self._robot.extended:
            for device in self._devices.values():
                device.proxy.keep_alive(False)
            async with self._stopping:
                await self._answer(functools.partial(self._robot._core.post, player.Stop()))
            return
        for device in self._devices.values():
            if isinstance(device, Position2d):
                await device.stop()

    async def status(self) -> dict[str, Any]:
        """Clients, queues, ages, beats, owners. Not from a stock server."""
        return cast(dict[str, Any], json.loads((await self._ask(player.GetStatus())).json))

    @property
    def connected(self) -> bool:
        """Whether there is a connection; with `reconnect` there may be none for a while."""
        return self._robot.connected

    @property
    def extended(self) -> bool:
        """The server is regista's. A stock Player server has no reasons, events, ownership."""
        return self._robot.extended

    def events(self) -> list[player.Event]:
        """What happened since the last call: refused commands, stops, faults."""
        return self._robot.events()

    def record(self, limit: int = 100_000) -> None:
        """Keep every data message for `messages()`; the newest `limit`."""
        self._robot.record(limit)

    def messages(self) -> list[Received]:
        """What came since the last call, in the order of arrival. Empty without `record()`."""
        return self._robot.messages()

    # ---- In the loop

    async def _next(self) -> None:
        """Until data come; raises what ended the connection."""
        if self._failure is not None:
            raise self._failure
        await asyncio.shield(self._news)

    async def _ask(self, request: Request[R]) -> R:
        """Of the server."""
        async with self._asking:
            return cast(R, await self._answer(functools.partial(self._robot._core.post, request)))

    async def _answer(self, post: Callable[[_Reply], object]) -> Any:
        """Of a request; `_asking` is held, or `_stopping`."""
        if self._failure is not None:
            raise self._failure
        reply: asyncio.Future[Any] = self._loop.create_future()

        def on_reply(value: Any, error: Exception | None) -> None:
            if reply.done():
                return
            if error is None:
                reply.set_result(value)
            else:
                reply.set_exception(error)

        post(on_reply)
        self._watch()
        try:
            return await asyncio.shield(reply)
        except asyncio.CancelledError:
            await self._settle(reply)  # the next request waits for the answer of this one
            raise

    @staticmethod
    async def _settle(reply: asyncio.Future[Any]) -> None:
        await asyncio.wait([reply])
        if not reply.cancelled():
            reply.exception()

    def _ready(self) -> None:
        try:
            came = self._robot.read(0)
        except Exception as error:
            self._unwatch()
            self._end(error)
            return
        if came:
            self._news.set_result(None)
            self._news = self._loop.create_future()
        self._watch()

    def _end(self, error: Exception) -> None:
        self._failure = error
        if not self._news.done():
            self._news.set_exception(error)
            self._news.exception()  # told to whoever waits; nobody has to

    def _watch(self) -> None:
        """Have the loop call `_ready` when there is something to read, room to write, or a time-out is due."""
        watched = (self._robot.fileno(), self._robot.poll_events())
        if watched != self._watched:
            self._unwatch()
            descriptor, events = watched
            if descriptor >= 0 and events & select.POLLIN:
                self._loop.add_reader(descriptor, self._ready)
            if descriptor >= 0 and events & select.POLLOUT:
                self._loop.add_writer(descriptor, self._ready)
            self._watched = watched
        if self._timer is not None:
            self._timer.cancel()
        wake = self._robot.wake_time
        self._timer = self._loop.call_at(wake, self._ready) if wake < float("inf") else None

    def _unwatch(self) -> None:
        if self._watched is not None and self._watched[0] >= 0:
            self._loop.remove_reader(self._watched[0])
            self._loop.remove_writer(self._watched[0])
        self._watched = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Device(Generic[X]):
    """What all devices have. `async for` yields each state that comes; a loop that is slow gets the newest.

    `proxy` is the device as `regista.Robot` knows it: its values and its commands, which never wait, such as
    `kicker.proxy.kick(5.0)`. Its requests would block the event loop: make them here.
    """

    def __init__(self, robot: Robot, proxy: X) -> None:
        self.robot = robot
        self.proxy = proxy

    def __repr__(self) -> str:
        return f"<asyncio {self.proxy!r}>"

    @builtins.property
    def address(self) -> str:
        """Such as "position2d:0"."""
        return self.proxy.address

    @overload
    def latest(self, kind: type[D]) -> Sample[D]: ...
    @overload
    def latest(self, kind: str) -> Sample[Data]: ...
    def latest(self, kind: type[D] | str) -> Sample[D] | Sample[Data]:
        """What came last of a data message, by class or by Player's name."""
        return self.proxy.latest(kind)

    async def each(self, kind: type[D]) -> AsyncIterator[D]:
        """Each data message of this class; a loop that is slow gets the newest."""
        count = self.proxy.latest(kind).count
        while True:
            sample = self.proxy.latest(kind)
            if sample.count != count:
                count = sample.count
                yield sample.value
            else:
                await self.robot._next()

    def __aiter__(self) -> AsyncIterator[Any]:
        return self.each(_state_of(self.proxy))

    def send(self, command: Command) -> None:
        """Send a command of this interface. Never waits: TimeoutError when the server has stopped reading."""
        self.proxy.send(command)

    async def request(self, request: Request[R]) -> R:
        """Ask and wait for the answer."""
        async with self.robot._asking:
            return cast(R, await self.robot._answer(functools.partial(self.proxy._core.post, request)))

    async def motion(self, group: str = "motion") -> player.Motion | None:
        """Who drives, and why it stands. None: a stock server does not tell."""
        if not self.robot.extended:
            return None
        return await self.robot._ask(player.GetMotion(address=self._wire_address(), group=group))

    async def take(self, group: str = "motion", *, blend: bool = False) -> None:
        """Drive from now on; see `regista.Device.take`."""
        if self.robot.extended:
            await self.robot._ask(player.Take(address=self._wire_address(), group=group, blend=int(blend)))

    async def release(self, group: str = "motion") -> None:
        """Leave it to others; the group comes to rest."""
        self.proxy.keep_alive(False)
        if self.robot.extended:
            await self.robot._ask(player.Release(address=self._wire_address(), group=group))

    @overload
    async def property(self, key: str) -> int | float | bool | str: ...
    @overload
    async def property(self, key: str, kind: type[P]) -> P: ...
    async def property(self, key: str, kind: type[P] | None = None) -> int | float | bool | str:
        """Its value; `kind` is float, int, bool or str, the driver's own. Without it, all four are tried."""
        refusal: RefusedError | None = None
        for one in PROPERTY_TYPES if kind is None else (kind,):
            try:
                async with self.robot._asking:
                    post = functools.partial(self.proxy._core.post_property, key, one)
                    return cast(float, await self.robot._answer(post))
            except RefusedError as error:
                refusal = error
        raise cast(RefusedError, refusal)

    async def set_property(self, key: str, value: bool | int | float | str) -> None:
        """The type must be the driver's own: 1 is an int, 1.0 a float."""
        async with self.robot._asking:
            await self.robot._answer(functools.partial(self.proxy._core.post_set_property, key, value))

    def _wire_address(self) -> player.DeviceAddress:
        interface, index = _core.device_code(self.address)
        return player.DeviceAddress(interface=interface, index=index)


class Position2d(Device[regista.Position2d]):
    """A base that moves in the plane; see `regista.Position2d`."""

    def __aiter__(self) -> AsyncIterator[position2d.State]:
        return self.each(position2d.State)

    @property
    def state(self) -> position2d.State:
        """Odometry."""
        return self.proxy.state

    def set_velocity(self, x: float = 0.0, y: float = 0.0, w: float = 0.0) -> None:
        """Drive at x [m/s] ahead, y [m/s] to the left, turning w [rad/s] to the left. To be repeated."""
        self.proxy.set_velocity(x, y, w)
        self.robot._watch()

    def go_to(self, x: float, y: float, heading: float = 0.0) -> None:
        """Go to (x [m], y [m], heading [rad]); stays valid while the event loop runs."""
        self.proxy.go_to(x, y, heading)
        self.robot._watch()

    async def stop(self) -> None:
        """Bring the base to rest, whoever drives it. Returns when the server has agreed."""
        self.proxy.keep_alive(False)
        if self.robot.extended:
            await self.robot._ask(player.Stop(address=self._wire_address()))
        else:
            self.proxy.send(position2d.VelocityCommand())

    async def drive_to(
        self,
        x: float,
        y: float,
        heading: float = 0.0,
        *,
        timeout: float,
        distance_m: float = 0.05,
        heading_rad: float = 0.1,
    ) -> None:
        """`go_to()`, and wait until the base is there; see `regista.Position2d.drive_to`."""
        await self.follow([(x, y, heading)], timeout=timeout, distance_m=distance_m, heading_rad=heading_rad)

    async def follow(
        self,
        path: Iterable[Pose2d | Sequence[float]],
        *,
        timeout: float,
        distance_m: float = 0.05,
        heading_rad: float = 0.1,
    ) -> None:
        """The same along poses or (x, y[, heading]); the headings count only at the end."""
        follower = _core.Follower(self.proxy._core, to_path(path), (distance_m, heading_rad))
        until = self.robot._loop.time() + timeout
        while not follower.step():
            self.robot._watch()
            left = until - self.robot._loop.time()
            if left <= 0:
                await self.stop()
                raise not_there(self.proxy, timeout)
            await self.robot.read(left)

    async def geometry(self) -> position2d.Geometry:
        """Where the base is on the robot, and how large."""
        return await self.request(position2d.GetGeometry())

    async def set_odometry(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> None:
        """The base is here now: x [m], y [m], heading [rad]."""
        await self.request(position2d.SetOdometry(pose=Pose2d(x, y, heading)))

    async def reset_odometry(self) -> None:
        """The base is at the origin of its odometry frame now."""
        await self.set_odometry()


def _state_of(proxy: regista.Device) -> type[Data]:
    """The first data message of the device's interface."""
    return type(proxy._core.value(_core.first_data(proxy.address)))
