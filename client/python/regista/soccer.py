# SPDX-License-Identifier: Apache-2.0
"""A team of RoboCup's Small Size League: its robots, each at a server of its own, and what the cameras see."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from types import TracebackType
from typing import Literal, NamedTuple, Self

from regista.geometry import BodyVelocity, Pose2d

try:
    from regista import _soccer
except ImportError as error:  # pragma: no cover
    raise ImportError(
        "regista was installed without soccer: apt install libprotobuf-dev protobuf-compiler libeigen3-dev, and install"
        " it again"
    ) from error

Colour = Literal["yellow", "blue"]


class SeenRobot(NamedTuple):
    """A robot as the cameras show it."""

    team: str
    """ "yellow" or "blue" """
    id: int
    x: float
    """[m]"""
    y: float
    """[m]"""
    heading: float
    """[rad]"""
    vx: float
    """[m/s], in the field"""
    vy: float
    """[m/s]"""
    w: float
    """[rad/s]"""
    visibility: float
    """0 to 1"""


class Ball(NamedTuple):
    """The ball as the cameras show it."""

    x: float
    """[m]"""
    y: float
    """[m]"""
    z: float
    """[m]"""
    vx: float
    """[m/s]"""
    vy: float
    """[m/s]"""
    vz: float
    """[m/s]"""
    visibility: float
    """0 to 1"""


class KickerState(NamedTuple):
    """What a robot's kicker says."""

    charged: bool
    """Ready to kick."""
    ball: bool
    """The ball lies before it."""
    kicks: int
    """So far."""


class TeamRobot:
    """One robot of a `Team`. What it is told holds until it is told something else; `Team.read()` repeats it.

    Numbers that are not finite are a ValueError.
    """

    def __init__(self, team: _soccer.Team, number: int) -> None:
        self._team = team
        self.id = number
        """Its pattern, 0 to 15."""

    def __repr__(self) -> str:
        return f"<TeamRobot {self.id}>"

    @property
    def connected(self) -> bool:
        """Whether its server is."""
        return self._team.connected(self.id)

    @property
    def pose(self) -> Pose2d:
        """Where it believes to be, in the field: camera, wheels and IMU, as its server told last."""
        x, y, heading = self._team.pose(self.id)
        return Pose2d(x=x, y=y, heading=heading)

    @property
    def velocity(self) -> BodyVelocity:
        """Likewise."""
        x, y, w = self._team.velocity(self.id)
        return BodyVelocity(x=x, y=y, w=w)

    @property
    def stopped_because(self) -> str:
        """Why it stands, although it was told to move; empty if it does not, or its server does not tell."""
        return self._team.stopped_because(self.id)

    @property
    def kicker(self) -> KickerState:
        """Its kicker; the first use subscribes, and it says something once `read()` has brought it."""
        return KickerState(*self._team.kicker(self.id))

    def is_at(
        self, x: float, y: float, heading: float = 0.0, *, distance_m: float = 0.05, heading_rad: float = 0.1
    ) -> bool:
        """`pose` is this near to (x [m], y [m], heading [rad])."""
        return self._team.is_at(self.id, (x, y, heading), distance_m, heading_rad)

    def drive_to(self, x: float, y: float, heading: float = 0.0) -> None:
        """Centralised: go there, steered from here by what vision shows, clear of all others.

        Stands while vision does not show it.
        """
        self._team.drive_to(self.id, (x, y, heading))

    def set_velocity(self, x: float = 0.0, y: float = 0.0, w: float = 0.0) -> None:
        """The same with a velocity in the field [m/s, rad/s], as far as others allow."""
        self._team.set_velocity(self.id, (x, y, w))

    def stop(self) -> None:
        """Stand."""
        self.set_velocity()

    def go_to(self, x: float, y: float, heading: float = 0.0) -> None:
        """Distributed: the robot plans, and corrects itself. It avoids nobody."""
        self._team.go_to(self.id, (x, y, heading))

    def kick(self, speed_mps: float) -> None:
        """Kick the ball flat. RefusedError: the robot has no kicker."""
        self._team.kick(self.id, speed_mps)

    def chip(self, speed_mps: float, angle_rad: float) -> None:
        """Lift the ball, at this angle above the floor."""
        self._team.chip(self.id, speed_mps, angle_rad)

    def dribble(self, speed_radps: float) -> None:
        """Turn the dribbler; positive holds the ball."""
        self._team.dribble(self.id, speed_radps)

    def charge(self, on: bool) -> None:
        """Charge the kicker, or do not."""
        self._team.charge(self.id, on)


class Team:
    """A team and one loop:

        with Team("team.cfg", "yellow") as team:  # the file that regista-vision-bridge reads
            while True:
                team[3].drive_to(1, 0.5)
                team.read(timeout=0.02)  # values change here, and velocities go out from here

    Steered robots keep clear of each other and of all that vision shows. One thread at a time. `read()` is to be called
    at least ten times a second: robots stop when their team is silent. A connection that is lost is made again.

    Args:
        config: Its `robot` sections name the servers, and `publish` in its section `vision` where the bridge's tracked
            vision goes; without that there is no ball, and nobody can be steered.
        team: "yellow" or "blue".
        speed_mps: Of what `drive_to` and `set_velocity` ask of a robot.
        acceleration_mps2: Likewise.
        turn_rate_radps: Likewise.
        gain: [1/s] on what is left of the way and of the turn.
        name: Shown to the servers; empty: "yellow team".
        priority: Of my wish to drive.

    Raises:
        ConnectionError: A robot's server cannot be reached.
        RuntimeError: The file has an error; with line and column.
    """

    def __init__(
        self,
        config: str | PathLike[str],
        team: Colour,
        *,
        speed_mps: float = 1.0,
        acceleration_mps2: float = 2.0,
        turn_rate_radps: float = 4.0,
        gain: float = 4.0,
        name: str = "",
        priority: int = 10,
    ) -> None:
        self._core = _soccer.Team(config, team, speed_mps, acceleration_mps2, turn_rate_radps, gain, name, priority)
        self._robots = {number: TeamRobot(self._core, number) for number in self._core.numbers()}

    def read(self, timeout: float) -> bool:
        """Take in what came, waiting up to `timeout` [s] for the first, and steer. False: none came in time."""
        return self._core.read(timeout)

    def seen(self, team: str, number: int) -> SeenRobot | None:
        """A robot of any team as the cameras show it."""
        return next((robot for robot in self.field() if (robot.team, robot.id) == (team, number)), None)

    def field(self) -> list[SeenRobot]:
        """All robots that the cameras show. Empty when nothing came for 0.5 s."""
        return [SeenRobot(*robot) for robot in self._core.seen()]

    @property
    def ball(self) -> Ball | None:
        """The ball; None when there is none, or nothing came for 0.5 s."""
        ball = self._core.ball()
        return None if ball is None else Ball(*ball)

    @property
    def seen_age(self) -> float | None:
        """[s] since the cameras' last news; None: there was none."""
        return self._core.seen_age()

    def close(self) -> None:
        """Close all connections."""
        self._core.close()

    def __getitem__(self, number: int) -> TeamRobot:
        """By its pattern. KeyError: the file does not have it."""
        return self._robots[number]

    def __iter__(self) -> Iterator[TeamRobot]:
        return iter(self._robots.values())

    def __len__(self) -> int:
        return len(self._robots)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
