# SPDX-License-Identifier: Apache-2.0
"""Verbs that ask or change one thing: get, set, odom, kick, stop."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

import regista

from . import common
from .common import JsonOption, RobotOption, TimeoutOption, examples
from .look import LOCALHOST, DeviceArgument

KeyArgument = Annotated[str, typer.Argument(metavar="KEY", help="The property's name.")]
CHARGE_SECONDS = 30.0
SETTLE_SECONDS = 0.3  # a refused command is told by an event, and not at once


def _kinds(text: str) -> list[Any]:
    """What a word may mean, the narrowest first."""
    values: list[Any] = []
    if text in ("true", "false"):
        values.append(text == "true")
    for kind in (int, float):
        try:
            values.append(kind(text))
        except ValueError:
            continue
    return [*values, text]


def get(
    device: DeviceArgument,
    key: KeyArgument,
    robot: RobotOption = LOCALHOST,
    json: JsonOption = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Read a property of a driver."""
    name = common.parse_device(device)
    with common.connect(robot, "get", timeout=timeout) as connection:
        value = connection.device(name).property(key)
    if json:
        common.print_json({"device": name, "key": key, "value": value})
    else:
        common.console.print(str(value).lower() if isinstance(value, bool) else str(value), markup=False)


def set_(
    device: DeviceArgument,
    key: KeyArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="A number, true, false, or text.")],
    robot: RobotOption = LOCALHOST,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Change a property of a driver."""
    name = common.parse_device(device)
    with common.connect(robot, "set", timeout=timeout) as connection:
        proxy = connection.device(name)
        kind = type(proxy.property(key))
        fitting = [meant for meant in _kinds(value) if type(meant) is kind]
        if not fitting:
            words = {float: "a number", int: "a whole number", bool: "true or false", str: "text"}
            common.fail(common.USAGE, f"{key} of {name} is {words[kind]}, not {value!r}")
        proxy.set_property(key, float(fitting[0]) if kind is float else fitting[0])


def odom(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="Which position2d.")] = "position2d:0",
    robot: RobotOption = LOCALHOST,
    reset: Annotated[bool, typer.Option("--reset", help="The robot is at the origin now.")] = False,
    place: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--set", metavar="X Y HEADING", help="The robot is there now: [m] [m] [rad]."),
    ] = None,
    json: JsonOption = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Read or set where the robot believes to be."""
    name = common.parse_device(device)
    with common.connect(robot, "odom", timeout=timeout) as connection:
        base = connection.position2d(common.index_of(name, "position2d"))
        if reset:
            base.reset_odometry()
        if place is not None:
            base.set_odometry(x=place[0], y=place[1], heading=place[2])
        connection.read(timeout=0)  # what came while we asked
        before = base.count
        deadline = time.monotonic() + timeout
        while base.count == before:
            if not connection.read(timeout=max(0.0, deadline - time.monotonic())) and time.monotonic() >= deadline:
                common.fail(common.TIMEOUT, f"{name} at {robot} said nothing for {common.duration(timeout)}")
        pose = base.state.pose
    if json:
        common.print_json({"device": name, "x": pose.x, "y": pose.y, "heading": pose.heading})
    else:
        common.console.print(f"x {pose.x:.3f} m, y {pose.y:.3f} m, heading {pose.heading:.3f} rad")


def kick(
    speed: Annotated[float, typer.Argument(metavar="SPEED", min=0, help="Of the ball [m/s].")],
    chip: Annotated[
        float | None, typer.Option("--chip", metavar="ANGLE", help="Chip at this angle above the floor [rad].")
    ] = None,
    charge: Annotated[bool, typer.Option("--charge", help="Charge the capacitor first.")] = False,
    device: Annotated[str, typer.Option("--device", "-d", help="Which kicker.")] = "kicker:0",
    robot: RobotOption = LOCALHOST,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Kick the ball, once."""
    name = common.parse_device(device)
    with common.connect(robot, "kick", timeout=timeout, priority=common.PEOPLE) as connection:
        kicker = connection.kicker(common.index_of(name, "kicker"))
        if charge:
            _charge(connection, kicker)
        if chip is None:
            kicker.kick(speed)
        else:
            kicker.chip(speed, chip)
        refuse_if_told(connection, name)


def _charge(connection: regista.Robot, kicker: regista.Kicker) -> None:
    kicker.charge(True)
    deadline = time.monotonic() + CHARGE_SECONDS
    while not kicker.state.charged:
        connection.read(timeout=0.1)
        _fail_if_refused(connection, kicker.address)
        if time.monotonic() > deadline:
            volts = f"{kicker.state.capacitor_v:.0f} V"
            common.fail(common.TIMEOUT, f"{kicker.address} is not charged after {CHARGE_SECONDS:.0f} s: {volts}")


def refuse_if_told(connection: regista.Robot, device: str) -> None:
    """A command has no answer: what was refused is told as an event."""
    until = time.monotonic() + SETTLE_SECONDS
    while time.monotonic() < until:
        connection.read(timeout=max(0.0, until - time.monotonic()))
        _fail_if_refused(connection, device)


def _fail_if_refused(connection: regista.Robot, device: str) -> None:
    for event in connection.events():
        if event.text.startswith(f"{device} refused"):
            common.fail(common.REFUSED, event.text)


def stop(robot: RobotOption = LOCALHOST, timeout: TimeoutOption = 2.0) -> None:
    """Bring every device to rest.

    Whoever drives it. This is no emergency stop."""
    with common.connect(robot, "stop", timeout=timeout, priority=common.PEOPLE) as connection:
        connection.stop()


def add_to(app: typer.Typer) -> None:
    app.command("get", epilog=examples("regista get position2d noise"))(get)
    app.command(
        "set",
        epilog=examples("regista set position2d noise 0.05"),
        context_settings={"ignore_unknown_options": True},  # -0.5 is a value
    )(set_)
    app.command("odom", epilog=examples("regista odom", "regista odom --reset", "regista odom --set 1 0.5 1.57"))(odom)
    app.command("kick", epilog=examples("regista kick 3 --charge", "regista kick 4 --chip 0.8"))(kick)
    app.command("stop", epilog=examples("regista stop", "regista stop --robot robot7"))(stop)
