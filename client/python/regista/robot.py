# SPDX-License-Identifier: Apache-2.0
"""Robots and the proxies of their devices."""

from __future__ import annotations

import builtins
import json
import select
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self, TypeVar, cast, overload
from weakref import WeakValueDictionary

from regista import _core, dio, gps, imu, kicker, opaque, player, position2d, power
from regista._core import Position2d as CorePosition2d
from regista.errors import RefusedError, TimeoutError
from regista.geometry import Pose2d
from regista.message import Command, Data, Received, Request, Sample

D = TypeVar("D", bound=Data)
R = TypeVar("R")
P = TypeVar("P", int, float, bool, str)

PROPERTY_TYPES: tuple[type, ...] = (float, int, bool, str)


class DeviceInfo(NamedTuple):
    """One of a server's devices."""

    address: str
    """Such as "position2d:0"."""
    driver: str


class Robot:
    """A connection to a server, regista's or a stock Player, and its devices:

        with regista.Robot("localhost") as robot:
            base = robot.position2d()
            while base.state.pose.x < 1.0:
                base.set_velocity(x=0.3)    # repeated: silence stops the robot
                robot.read(timeout=0.1)     # values change here, and only here
            base.stop()

    No background thread: the caller owns the loop. One thread at a time, in the process that connected: another thread
    and a forked child get a RuntimeError. Whatever waits lets other threads run, and ends with Ctrl-C.

    Args:
        host: Name or address of the server.
        port: Its TCP port.
        timeout: [s] to connect, for each answer, and for the server's silence before it counts as lost.
        name: Shown to the others; empty: program@host.
        priority: Of my wish to drive: 10 programs, 20 people.
        mode: "push", or "pull": the server sends only when read() asks.
        reconnect: `read()` connects again, with back-off, instead of failing.

    Raises:
        ConnectionError: Nobody answers, or not as a Player server does.
    """

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
        if mode not in ("push", "pull"):
            raise ValueError(f'mode is "push" or "pull", not {mode!r}')
        self.host = host
        self.port = port
        # Weak: a device holds its robot, and a robot that nobody holds closes itself.
        self._devices: WeakValueDictionary[str, Device] = WeakValueDictionary()
        self._core = _core.Robot(host, port, timeout, name or _own_name(), priority, mode == "pull", reconnect)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the devices and the connection. Blocks for the timeout at most. What comes after is a ValueError."""
        self._core.close()

    def read(self, timeout: float) -> bool:
        """Take in the data that came, waiting up to `timeout` [s] for the first; 0 only looks.

        False: none came in time. Raises ConnectionError or TimeoutError when the connection broke or the server is
        silent for good; with `reconnect` it connects again instead, and commands fail until `connected`.
        """
        return self._core.read(timeout)

    # Devices; the first use subscribes.

    def position2d(self, index: int = 0) -> Position2d:
        """A base that moves in the plane."""
        return self._proxy(Position2d, f"position2d:{index}")

    def power(self, index: int = 0) -> Power:
        """Battery or supply."""
        return self._proxy(Power, f"power:{index}")

    def kicker(self, index: int = 0) -> Kicker:
        """Kicker and dribbler of a soccer robot."""
        return self._proxy(Kicker, f"kicker:{index}")

    def imu(self, index: int = 0) -> Imu:
        """Inertial measurement unit."""
        return self._proxy(Imu, f"imu:{index}")

    def gps(self, index: int = 0) -> Gps:
        """Satellite receiver."""
        return self._proxy(Gps, f"gps:{index}")

    def dio(self, index: int = 0) -> Dio:
        """Digital inputs and outputs."""
        return self._proxy(Dio, f"dio:{index}")

    def opaque(self, index: int = 0) -> Opaque:
        """Bytes that only the driver and its client understand."""
        return self._proxy(Opaque, f"opaque:{index}")

    def device(self, address: str) -> Device:
        """A device of any interface: "actarray:0". Of the interfaces above, the same object as there."""
        interface, _, index = address.partition(":")
        return self._proxy(_PROXIES.get(interface, Device), f"{interface}:{index or 0}")

    def devices(self) -> list[DeviceInfo]:
        """All devices of the server."""
        return [DeviceInfo(address, driver) for address, driver in self._core.devices()]

    def stop(self) -> None:
        """Bring every device to rest, whoever drives it. On a stock server: the position2d devices in use."""
        self._core.stop()

    def reconnect(self) -> None:
        """Connect again and subscribe what was subscribed. Moves nothing: take ownership and send destinations anew."""
        self._core.reconnect()

    @property
    def connected(self) -> bool:
        """Whether there is a connection; with `reconnect` there may be none for a while."""
        return self._core.connected

    @property
    def server(self) -> str:
        """What the server calls itself, such as "Player v.3.1.1-dev"."""
        return self._core.server

    @property
    def extended(self) -> bool:
        """The server is regista's: reasons, events, ownership. A stock Player server has none of it."""
        return self._core.extended

    @property
    def generation(self) -> int:
        """How often it was connected: another number means that ownership and destinations are void."""
        return self._core.generation

    def events(self) -> list[player.Event]:
        """What happened since the last call: refused commands, stops, faults. The newest 256.

        A stock server tells none.
        """
        return self._core.events()

    def status(self) -> dict[str, Any]:
        """Clients, queues, ages, beats, owners. Not from a stock server."""
        return cast(dict[str, Any], json.loads(self._core.status()))

    def record(self, limit: int = 100_000) -> None:
        """Keep every data message of the devices in use, from now on, for `messages()`; the newest `limit`. 0: no more.

        What comes while a request waits is kept of each device and type the newest; `counters()` tells.
        """
        self._core.record(limit)

    def messages(self) -> list[Received]:
        """What `read()` brought since the last call, in the order of arrival. Empty without `record()`."""
        return self._core.messages()

    def counters(self) -> dict[str, int]:
        """What was dropped, and why: `overflows` of `record()`, `superseded` during requests, `undecodable`, …"""
        return self._core.counters()

    def fileno(self) -> int:
        """For select, poll, asyncio: call `read(0)` when it is ready for `poll_events()`. -1: there is no socket."""
        return self._core.fileno()

    def poll_events(self) -> int:
        """`select.POLLIN`, `select.POLLOUT`."""
        return self._core.poll_events()

    @property
    def wake_time(self) -> float:
        """When `read(0)` is due although nothing came: seconds of `time.monotonic()`, `math.inf` for never."""
        return self._core.wake_time

    def _proxy(self, kind: type[X], address: str) -> X:
        proxy = self._devices.get(address)
        if proxy is None:
            proxy = self._devices[address] = kind(self, address)
        return cast(X, proxy)


class Device:
    """What all devices have. Every request blocks for the robot's timeout at most.

    Raises:
        RefusedError: The server or the device said no.
        TimeoutError: No answer in time.
        ConnectionError: There is no connection.
    """

    def __init__(self, robot: Robot, address: str) -> None:
        self.robot = robot
        self._core = self._open(address)
        self._subtypes: dict[object, int] = {}

    def _open(self, address: str) -> _core.Device:
        return _core.Device(self.robot._core, address)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.address} at {self.robot.host}:{self.robot.port}>"

    @builtins.property
    def address(self) -> str:
        """Such as "position2d:0"."""
        return self._core.address

    @builtins.property
    def driver(self) -> str:
        """The name of its driver."""
        return self._core.driver

    @builtins.property
    def count(self) -> int:
        """How many data messages have come: another number after `read()` means something new."""
        return self._core.count

    @builtins.property
    def age(self) -> float | None:
        """[s] since any data of this device arrived; None when none has."""
        return self._core.age

    @overload
    def latest(self, kind: type[D]) -> Sample[D]: ...
    @overload
    def latest(self, kind: str) -> Sample[Data]: ...
    def latest(self, kind: type[D] | str) -> Sample[D] | Sample[Data]:
        """What came last of a data message: by class, `latest(actarray.State)`, or by Player's name, "STATE"."""
        return Sample(*self._core.latest(self._subtype(kind)))

    def send(self, command: Command) -> None:
        """Send a command of this interface. Never blocks: TimeoutError when the server has stopped reading."""
        self._core.send(command)

    def request(self, request: Request[R]) -> R:
        """Ask and wait for the answer."""
        return cast(R, self._core.request(request))

    # Who drives.

    def motion(self, group: str = "motion") -> player.Motion | None:
        """Who drives, and why it stands: asks at first, and follows in `read()`. None: a stock server does not tell."""
        return cast("player.Motion | None", self._core.motion(group))

    def take(self, group: str = "motion", *, blend: bool = False) -> None:
        """Drive from now on, taking over from an owner of at most this robot's priority.

        The group comes to rest first, unless `blend`. On a stock server everybody may drive, and this does nothing.
        """
        self._core.take(group, blend)

    def release(self, group: str = "motion") -> None:
        """Leave it to others; the group comes to rest."""
        self._core.release(group)

    def keep_alive(self, on: bool) -> None:
        """The device has a destination that stays valid while this program calls `read()`; `go_to` says so itself."""
        self._core.keep_alive(on)

    # Properties of the driver by name.

    def set_property(self, key: str, value: bool | int | float | str) -> None:
        """The type must be the driver's own: 1 is an int, 1.0 a float."""
        self._core.set_property(key, value)

    def _subtype(self, kind: object) -> int:
        subtype = self._subtypes.get(kind)
        if subtype is None:
            subtype = self._core.subtype_of(kind)
            self._subtypes[kind] = subtype
        return subtype

    @overload
    def property(self, key: str) -> int | float | bool | str: ...
    @overload
    def property(self, key: str, kind: type[P]) -> P: ...
    def property(self, key: str, kind: type[P] | None = None) -> int | float | bool | str:
        """Its value; `kind` is float, int, bool or str, the driver's own. Without it, all four are tried."""
        if kind is not None:
            return cast(P, self._core.property(key, kind))
        refusal: RefusedError | None = None
        for kind in PROPERTY_TYPES:
            try:
                return cast(float, self._core.property(key, kind))
            except RefusedError as error:
                refusal = error
        raise cast(RefusedError, refusal)


X = TypeVar("X", bound=Device)


class Position2d(Device):
    """A base that moves in the plane: +x forward, +y left, +w counter-clockwise; poses in its odometry frame.

    Numbers that are not finite are a ValueError.
    """

    _core: CorePosition2d

    def _open(self, address: str) -> CorePosition2d:
        return CorePosition2d(self.robot._core, _index(address))

    @property
    def state(self) -> position2d.State:
        """Odometry: `pose` in [m] and [rad], `velocity` of the body in [m/s] and [rad/s]."""
        return cast(position2d.State, self._core.value(1))

    def set_velocity(self, x: float = 0.0, y: float = 0.0, w: float = 0.0) -> None:
        """Drive at x [m/s] ahead, y [m/s] to the left, turning w [rad/s] to the left.

        Say it again and again: a server stops a base whose client has been silent for its lease, usually 0.5 s.
        """
        self._core.set_velocity(x, y, w)

    def go_to(
        self,
        x: float,
        y: float,
        heading: float = 0.0,
        *,
        limits: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Go to (x [m], y [m], heading [rad]), for a base that takes position commands.

        No faster than `limits` (x [m/s], y [m/s], w [rad/s]), where 0 is the base's own limit. The destination stays
        valid while this program calls `read()`.
        """
        self._core.go_to((x, y, heading), limits)

    def stop(self) -> None:
        """Bring the base to rest, whoever drives it. Returns when the server has agreed."""
        self._core.stop()

    def is_at(
        self, x: float, y: float, heading: float = 0.0, *, distance_m: float = 0.05, heading_rad: float = 0.1
    ) -> bool:
        """`state` is this near to (x [m], y [m], heading [rad])."""
        return self._core.is_at((x, y, heading), (distance_m, heading_rad))

    def drive_to(
        self,
        x: float,
        y: float,
        heading: float = 0.0,
        *,
        timeout: float,
        distance_m: float = 0.05,
        heading_rad: float = 0.1,
    ) -> None:
        """`go_to()` and `read()` until the base is there.

        Raises TimeoutError after stopping the base; RefusedError with the reason when somebody or something stops it on
        the way.
        """
        self.follow([(x, y, heading)], timeout=timeout, distance_m=distance_m, heading_rad=heading_rad)

    def follow(
        self,
        path: Iterable[Pose2d | Sequence[float]],
        *,
        timeout: float,
        distance_m: float = 0.05,
        heading_rad: float = 0.1,
    ) -> None:
        """The same along poses or (x, y[, heading]); the headings count only at the end."""
        follower = _core.Follower(self._core, to_path(path), (distance_m, heading_rad))
        until = time.monotonic() + timeout
        while not follower.step():
            left = until - time.monotonic()
            if left <= 0:
                self.stop()
                raise not_there(self, timeout)
            self.robot.read(left)

    def geometry(self) -> position2d.Geometry:
        """Where the base is on the robot, and how large."""
        return self.request(position2d.GetGeometry())

    def set_odometry(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> None:
        """The base is here now: x [m], y [m], heading [rad]."""
        self._core.set_odometry((x, y, heading))

    def reset_odometry(self) -> None:
        """The base is at the origin of its odometry frame now."""
        self.set_odometry()

    def set_motor_power(self, on: bool) -> None:
        """Motors on or off."""
        self.request(position2d.SetMotorPower(on=int(on)))

    def set_position_mode(self, on: bool) -> None:
        """Position control instead of velocity control, for stock servers whose drivers ask for it."""
        self.request(position2d.SetPositionMode(position=int(on)))

    def set_speed_pid(self, kp: float, ki: float, kd: float) -> None:
        """Gains of the speed controller."""
        self.request(position2d.SetSpeedPid(kp=kp, ki=ki, kd=kd))

    def set_position_pid(self, kp: float, ki: float, kd: float) -> None:
        """Gains of the position controller."""
        self.request(position2d.SetPositionPid(kp=kp, ki=ki, kd=kd))

    def set_speed_profile(self, speed_mps: float, acceleration_mps2: float) -> None:
        """Largest speed [m/s] and acceleration [m/s²]."""
        self.request(position2d.SetSpeedProfile(speed_mps=speed_mps, acceleration_mps2=acceleration_mps2))


class Power(Device):
    """Battery or supply. What the device does not measure is None."""

    @property
    def state(self) -> power.State:
        """All that it says, with the bits of what is valid."""
        return cast(power.State, self._core.value(1))

    @property
    def voltage_v(self) -> float | None:
        """[V]"""
        return self.state.voltage_v if self.state.valid & 1 else None

    @property
    def power_w(self) -> float | None:
        """[W] drawn from the battery."""
        return self.state.power_w if self.state.valid & 2 else None

    @property
    def energy_j(self) -> float | None:
        """[J] left in the battery."""
        return self.state.energy_j if self.state.valid & 4 else None

    @property
    def charge_percent(self) -> float | None:
        """[%]"""
        return self.state.charge_percent if self.state.valid & 8 else None

    def set_charging_policy(self, *, input: bool, output: bool) -> None:
        """May it be charged, and charge others?"""
        self.request(power.SetChargingPolicy(enable_input=int(input), enable_output=int(output)))


class Kicker(Device):
    """Kicker and dribbler of a soccer robot."""

    @property
    def state(self) -> kicker.State:
        """Charge, ball, kicks so far."""
        return cast(kicker.State, self._core.value(1))

    def kick(self, speed_mps: float) -> None:
        """Kick the ball flat, at this speed [m/s]."""
        self.send(kicker.KickCommand(speed_mps=speed_mps))

    def chip(self, speed_mps: float, angle_rad: float) -> None:
        """Lift the ball at this speed [m/s] and angle [rad] above the ground."""
        self.send(kicker.ChipCommand(speed_mps=speed_mps, angle_rad=angle_rad))

    def dribble(self, speed_radps: float) -> None:
        """Turn the dribbler [rad/s]; positive holds the ball."""
        self.send(kicker.DribblerCommand(speed_radps=speed_radps))

    def charge(self, on: bool) -> None:
        """Charge the capacitors, or do not."""
        self.send(kicker.ChargeCommand(on=int(on)))

    def geometry(self) -> kicker.Geometry:
        """Where the kicker is on the robot."""
        return self.request(kicker.GetGeometry())

    def limits(self) -> kicker.Limits:
        """What it can do."""
        return self.request(kicker.GetLimits())


class Imu(Device):
    """Inertial measurement unit. Which of its messages come is set with `set_data_type(imu.Calibrated)`."""

    @property
    def state(self) -> imu.State:
        """Its pose, as it integrates it."""
        return cast(imu.State, self._core.value(1))

    @property
    def calibrated(self) -> imu.Calibrated:
        """Samples of the three sensors."""
        return cast(imu.Calibrated, self._core.value(2))

    @property
    def quaternion(self) -> imu.Quaternion:
        """Samples and orientation."""
        return cast(imu.Quaternion, self._core.value(3))

    @property
    def euler(self) -> imu.Euler:
        """Samples and orientation."""
        return cast(imu.Euler, self._core.value(4))

    @property
    def full_state(self) -> imu.FullState:
        """Pose, velocity, acceleration."""
        return cast(imu.FullState, self._core.value(5))

    def set_data_type(self, kind: type[Data]) -> None:
        """Publish this message, such as `imu.Calibrated`."""
        self.request(imu.SetDataType(subtype=self._subtype(kind)))

    def reset_orientation(self) -> None:
        """The present orientation is the origin."""
        self.request(imu.ResetOrientation())


class Gps(Device):
    """Satellite receiver."""

    @property
    def state(self) -> gps.State:
        """All that it says, in Player's integers."""
        return cast(gps.State, self._core.value(1))

    @property
    def latitude_deg(self) -> float:
        """[degrees], WGS 84, north positive."""
        return self.state.latitude / 1e7

    @property
    def longitude_deg(self) -> float:
        """[degrees], WGS 84, east positive."""
        return self.state.longitude / 1e7

    @property
    def altitude_m(self) -> float:
        """[m]"""
        return self.state.altitude_mm / 1e3


class Dio(Device):
    """Digital inputs and outputs; bit 0 is number 0."""

    @property
    def state(self) -> dio.State:
        """The inputs."""
        return cast(dio.State, self._core.value(1))

    def input(self, number: int) -> bool:
        """Input `number`; False when there is none."""
        return 0 <= number < self.state.count and bool(self.state.bits >> number & 1)

    def set_outputs(self, count: int, bits: int) -> None:
        """The first `count` outputs."""
        self.send(dio.OutputCommand(count=count, bits=bits))


class Opaque(Device):
    """Bytes that only the driver and its client understand."""

    @property
    def bytes(self) -> builtins.bytes:
        """What came last."""
        return cast(opaque.State, self._core.value(1)).bytes

    def send_bytes(self, data: builtins.bytes) -> None:
        """As a command."""
        self.send(opaque.Command(bytes=data))

    def request_bytes(self, data: builtins.bytes) -> builtins.bytes:
        """As a request; returns the bytes of the answer."""
        return self.request(opaque.Request(bytes=data)).bytes


class Team:
    """Several robots, one loop:

    with Team() as team:
        for host in ("robot1", "robot2"):
            team.add(regista.Robot(host))
        while team.read(timeout=0.1):
            for robot in team:
                robot.position2d().set_velocity(w=0.5)
    """

    def __init__(self, robots: Iterable[Robot] = ()) -> None:
        self._robots = list(robots)

    def add(self, robot: Robot) -> Robot:
        """One more; it is the team's to close."""
        self._robots.append(robot)
        return robot

    def read(self, timeout: float) -> bool:
        """Take in what came from any robot, waiting up to `timeout` [s] for the first. False: none came in time.

        When robots fail, the others are read before the first failure is raised.
        """
        until = time.monotonic() + timeout
        while True:
            came, failures = False, []
            poll = select.poll()
            wake = until
            for robot in self._robots:
                try:
                    came = robot.read(0) or came
                except OSError as error:
                    failures.append(error)
                wake = min(wake, robot.wake_time)
                if (descriptor := robot.fileno()) >= 0:
                    poll.register(descriptor, robot.poll_events())
            if failures:
                raise failures[0]
            now = time.monotonic()
            if came or now >= until:
                return came
            poll.poll(max(wake - now, 0) * 1000 + 1)

    def close(self) -> None:
        """Close all robots."""
        for robot in self._robots:
            robot.close()

    def __len__(self) -> int:
        return len(self._robots)

    def __iter__(self) -> Iterator[Robot]:
        return iter(self._robots)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


_PROXIES: dict[str, type[Device]] = {
    "position2d": Position2d,
    "power": Power,
    "kicker": Kicker,
    "imu": Imu,
    "gps": Gps,
    "dio": Dio,
    "opaque": Opaque,
}


def to_path(path: Iterable[Pose2d | Sequence[float]]) -> list[tuple[float, float, float]]:
    """Poses, or sequences (x, y[, heading])."""
    triples = []
    for pose in path:
        x, y, *heading = (pose.x, pose.y, pose.heading) if isinstance(pose, Pose2d) else pose
        triples.append((x, y, heading[0] if heading else 0.0))
    return triples


def not_there(base: Position2d, timeout: float) -> TimeoutError:
    """The error of a destination that was not reached."""
    host, port, reason = base.robot.host, base.robot.port, f"not there after {timeout:g} s"
    text = f"{base.address} at {host}:{port}: drive: {reason}"
    return TimeoutError(text, host, port, base.address, "drive", reason)


def _own_name() -> str:
    program = Path(sys.argv[0]).stem if sys.argv and sys.argv[0] not in ("", "-c") else "python"
    return f"{program[:30]}@{socket.gethostname()[:30]}"


def _index(address: str) -> int:
    index = address.partition(":")[2]
    if not index.isdecimal() or int(index) > 0xFFFF:
        raise ValueError(f"'{address}' is no device: wants INTERFACE:INDEX, such as position2d:0")
    return int(index)
