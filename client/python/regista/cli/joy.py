# SPDX-License-Identifier: Apache-2.0
"""`regista joy`: a gamepad drives the robot."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import struct
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.live import Live
from rich.text import Text

from . import common
from .common import RobotOption, TimeoutOption, examples
from .drive import Session, ends_on_signals
from .hand import AXES, BUTTONS, DeadMan, Layout, Pad, Velocity
from .look import LOCALHOST

HELP = "Hold the dead man's button to drive; the turbo button doubles the speed; the stop button stops every device."


def axis_range(descriptor: int, axis: int) -> tuple[int, int] | None:
    """EVIOCGABS of linux/input.h: struct input_absinfo. None: no such axis, or a file that is no event device."""
    size = 24
    request = (2 << 30) | (size << 16) | (ord("E") << 8) | (0x40 + axis)  # _IOR('E', 0x40 + axis, …)
    try:
        answer = fcntl.ioctl(descriptor, request, bytes(size))
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            return None
        raise
    _, low, high, *_ = struct.unpack("6i", answer)
    return (low, high) if high > low else None


def find_pad(folder: Path = Path("/dev/input/by-id")) -> Path:
    """The first gamepad, by the name that udev gives it."""
    pads = sorted(folder.glob("*-event-joystick")) if folder.is_dir() else []
    if not pads:
        common.fail(
            common.FAILED,
            f"no gamepad: {folder}/*-event-joystick matches nothing. Plug one in, or name it: --pad /dev/input/event7",
        )
    return pads[0]


def _code(name: str, known: dict[str, int], option: str) -> int:
    if name.isdecimal():
        return int(name)
    if name not in known:
        common.fail(
            common.USAGE, f"{option} {name}: known are {', '.join(known)}; or give its number, as evtest shows it"
        )
    return known[name]


def joy(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="Which position2d.")] = "position2d:0",
    robot: RobotOption = LOCALHOST,
    pad: Annotated[
        Path | None, typer.Option("--pad", metavar="FILE", help="Its event device; default: the first gamepad.")
    ] = None,
    speed: Annotated[float, typer.Option("--speed", min=0.01, max=10, metavar="M/S", help="With turbo.")] = 0.6,
    turn: Annotated[float, typer.Option("--turn", min=0.01, max=20, metavar="RAD/S", help="With turbo.")] = 1.6,
    hold: Annotated[str, typer.Option("--hold", metavar="BUTTON", help="The dead man's button.")] = "BTN_TL",
    turbo: Annotated[str, typer.Option("--turbo", metavar="BUTTON", help="Full speed while held.")] = "BTN_TR",
    stop: Annotated[str, typer.Option("--stop", metavar="BUTTON", help="Stops every device.")] = "BTN_EAST",
    ahead: Annotated[str, typer.Option("--ahead", metavar="AXIS", help="Up is ahead.")] = "ABS_Y",
    side: Annotated[str, typer.Option("--side", metavar="AXIS", help="Left is to the left.")] = "ABS_RX",
    turning: Annotated[str, typer.Option("--turning", metavar="AXIS", help="Left is counter-clockwise.")] = "ABS_X",
    timeout: TimeoutOption = 2.0,
) -> None:
    """Drive with a gamepad.

    Nothing moves unless the dead man's button is held; unplugging the gamepad lets go."""
    name = common.parse_device(device)
    index = common.index_of(name, "position2d")
    layout = Layout(
        ahead=_code(ahead, AXES, "--ahead"),
        turn=_code(turning, AXES, "--turning"),
        side=_code(side, AXES, "--side"),
        hold=_code(hold, BUTTONS, "--hold"),
        turbo=_code(turbo, BUTTONS, "--turbo"),
        stop=_code(stop, BUTTONS, "--stop"),
    )
    path = pad or find_pad()
    descriptor = open_pad(path)
    try:
        axes = (layout.ahead, layout.turn, layout.side)
        ranges = {axis: found for axis in axes if (found := axis_range(descriptor, axis)) is not None}
        with common.connect(robot, "joy", timeout=timeout, priority=common.PEOPLE) as connection:
            session = Session(connection, index, DeadMan())
            with ends_on_signals():
                try:
                    _loop(session, Pad(layout, speed, turn, ranges), descriptor, path)
                finally:
                    session.finish()
    finally:
        os.close(descriptor)


def open_pad(path: Path) -> int:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except PermissionError:
        common.fail(
            common.FAILED, f"{path}: permission denied; add yourself to its group: sudo usermod -aG input $USER"
        )
    except OSError as error:
        common.fail(common.FAILED, f"{path}: {error.strerror}; is the gamepad plugged in?")


def _loop(session: Session, pad: Pad, descriptor: int, path: Path) -> None:
    held: Velocity | None = None
    drawn = 0.0
    with Live(console=common.console, auto_refresh=False, transient=True) as live:
        while True:
            ready, _, _ = select.select([descriptor, session.connection.fileno()], [], [], session.timeout())
            if descriptor in ready:
                pad.feed(_events(session, descriptor, path))
                held = pad.velocity()
                if held is None:
                    session.dead_man.let_go()
                else:
                    session.dead_man.hold(held)
                if pad.stop_pressed:
                    pad.stop_pressed = False
                    session.stop()
            session.step()
            now = time.monotonic()
            if common.console.is_terminal and now - drawn >= 0.2:
                drawn = now
                live.update(Group(session.lines(held), Text(HELP, style="dim")), refresh=True)


def _events(session: Session, descriptor: int, path: Path) -> bytes:
    try:
        data = os.read(descriptor, 4096)
    except OSError as error:
        if error.errno != errno.ENODEV:
            raise
        data = b""
    if not data:
        session.finish()
        common.fail(common.FAILED, f"the gamepad {path} is gone; {session.base.address} was let go")
    return data


def add_to(app: typer.Typer) -> None:
    app.command(
        "joy",
        epilog=examples(
            "regista joy", "regista joy --pad /dev/input/event7 --hold BTN_TL --ahead ABS_Y --turning ABS_RX"
        ),
    )(joy)
