# SPDX-License-Identifier: Apache-2.0
"""`regista drive`: the keyboard of a terminal drives the robot."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Iterator
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.live import Live
from rich.text import Text

import regista

from . import common
from .common import RobotOption, TimeoutOption, examples
from .hand import DeadMan, Keys, Release, Velocity
from .look import LOCALHOST

HELP = """\
  w, up     ahead          q  to the left    +  faster       t  take over from whoever drives
  s, down   back           e  to the right   -  slower       x  end (also Ctrl-C)
  a, left   turn left      d, right  turn right              space  stop every device
A terminal does not tell when a key is let go: a tap drives for 0.6 s, a held key stops 0.2 s after you let it go."""


class Session:
    """The robot's side of driving by hand, whatever the hand holds: sends what the dead man's switch says, and knows
    what the person should see."""

    def __init__(self, connection: regista.Robot, index: int, dead_man: DeadMan) -> None:
        self.connection = connection
        self.base = connection.position2d(index)
        self.dead_man = dead_man
        self.told = ""  # the last event about this device

    def step(self) -> None:
        """Send what is due, and take in what came. Does not block."""
        while (action := self.dead_man.step(time.monotonic())) is not None:
            if isinstance(action, Release):
                self.release()
            else:
                self.base.set_velocity(x=action.x, y=action.y, w=action.w)
        self.connection.read(timeout=0)
        for event in self.connection.events():
            if event.text.startswith(self.base.address):
                self.told = event.text

    def stop(self) -> None:
        """Let go, and stop every device, whoever drives it."""
        self.dead_man.let_go()
        self.connection.stop()

    def take(self) -> None:
        """From whoever drives, if he is not more important."""
        try:
            self.base.take()
            self.told = ""
        except regista.RefusedError as error:
            self.told = str(error)

    def release(self) -> None:
        with contextlib.suppress(regista.RefusedError):  # it was not ours
            self.base.release()

    def finish(self) -> None:
        """Whatever happened: zero, and give the robot back, as far as there is a connection."""
        self.dead_man.let_go()
        try:
            while self.dead_man.active:
                self.step()
                time.sleep(max(0.0, min(DeadMan.REPEAT, self.dead_man.due() - time.monotonic())))
        except regista.Error:
            pass  # the server stops what its client left

    def timeout(self) -> float:
        """How long select() may wait [s]."""
        return max(0.0, min(0.1, self.dead_man.due() - time.monotonic()))

    def lines(self, velocity: Velocity | None) -> Text:
        motion = self.base.motion()
        text = Text()
        connection = self.connection
        text.append(f"{self.base.address} at {connection.host}:{connection.port}\n", style="bold")
        if motion is None:
            text.append("driven by: a stock Player server does not tell\n")
        else:
            owner = f"{motion.owner} (prio {motion.priority})" if motion.owner else "nobody"
            state = common.state_name(motion.state)
            style = "green" if state == "driving" else "yellow"
            text.append(f"driven by: {owner}   ")
            text.append(state.upper(), style=style)
            text.append(f"{': ' + motion.reason if motion.reason else ''}\n")
        pose, speed = self.base.state.pose, self.base.state.velocity
        age = self.base.age
        text.append(f"pose      x {pose.x:7.2f} m    y {pose.y:7.2f} m    heading {pose.heading:6.2f} rad\n")
        text.append(f"velocity  x {speed.x:7.2f} m/s  y {speed.y:7.2f} m/s  w {speed.w:12.2f} rad/s")
        text.append(f"   age {common.duration(age)}\n" if age is not None else "   no data yet\n")
        if velocity is None:
            text.append("you       nothing held\n")
        else:
            text.append(f"you       x {velocity.x:7.2f} m/s  y {velocity.y:7.2f} m/s  w {velocity.w:12.2f} rad/s\n")
        if self.told:
            text.append(self.told, style="yellow")
        return text


@contextlib.contextmanager
def raw_keys(descriptor: int) -> Iterator[None]:
    """Keys come at once and unseen; Ctrl-C stays an interrupt. The terminal is put back whatever happens."""
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


@contextlib.contextmanager
def ends_on_signals() -> Iterator[None]:
    """A closed terminal or a kill ends as Ctrl-C does: with the robot at rest."""

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGHUP, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def drive(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="Which position2d.")] = "position2d:0",
    robot: RobotOption = LOCALHOST,
    speed: Annotated[float, typer.Option("--speed", min=0.01, max=10, metavar="M/S", help="Ahead and sideways.")] = 0.3,
    turn: Annotated[float, typer.Option("--turn", min=0.01, max=20, metavar="RAD/S", help="When turning.")] = 0.8,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Drive with the keyboard.

    Nothing moves unless a key is held. Tells who drives, and takes over only when you ask for it."""
    if not sys.stdin.isatty():
        common.fail(common.USAGE, "drive wants a terminal to read keys from, and standard input is none")
    name = common.parse_device(device)
    index = common.index_of(name, "position2d")
    with common.connect(robot, "drive", timeout=timeout, priority=common.PEOPLE) as connection:
        session = Session(connection, index, DeadMan())
        keys = Keys(speed, turn)
        with raw_keys(sys.stdin.fileno()), ends_on_signals():
            try:
                _loop(session, keys, sys.stdin.fileno())
            finally:
                session.finish()


def _loop(session: Session, keys: Keys, descriptor: int) -> None:
    velocity: Velocity | None = None
    drawn = 0.0
    with Live(console=common.console, auto_refresh=False, transient=True) as live:
        while True:
            ready, _, _ = select.select([descriptor, session.connection.fileno()], [], [], session.timeout())
            if descriptor in ready:
                data = os.read(descriptor, 1024)
                if not data:  # the terminal is gone
                    return
                for key in keys.names(data.decode("utf-8", "replace")):
                    if key == "x":
                        return
                    velocity = _press(session, keys, key) or velocity
            session.step()
            now = time.monotonic()
            if descriptor in ready or now - drawn >= 0.2:
                drawn = now
                held = velocity if session.dead_man.held else None
                scale = f"speed {keys.speed:.2f} m/s, turn {keys.turn:.2f} rad/s"
                live.update(Group(session.lines(held), Text(scale), Text(HELP, style="dim")), refresh=True)


def _press(session: Session, keys: Keys, key: str) -> Velocity | None:
    if key == " ":
        session.stop()
    elif key == "t":
        session.take()
    elif key in "+-":
        keys.scale(1.1 if key == "+" else 1 / 1.1)
    elif (held := keys.press(key, time.monotonic())) is not None:
        session.dead_man.hold(*held)
        return held[0]
    return None


def add_to(app: typer.Typer) -> None:
    app.command(
        "drive", epilog=examples("regista drive", "regista drive --robot robot7 --speed 0.5") + f"\n\n\b\nKeys:\n{HELP}"
    )(drive)
