# SPDX-License-Identifier: Apache-2.0
"""Verbs that only look: list, info, print, status, clients."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer
from rich.live import Live
from rich.table import Table

import regista

from .. import recording
from . import common
from .common import JsonOption, RobotOption, TimeoutOption, examples

LOCALHOST = f"localhost:{common.PORT}"
DeviceArgument = Annotated[
    str, typer.Argument(metavar="DEVICE", help="Such as position2d:0; the index 0 may be left out.")
]


def list_devices(robot: RobotOption = LOCALHOST, json: JsonOption = False, timeout: TimeoutOption = 2.0) -> None:
    """Name the devices of the robot and their drivers."""
    with common.connect(robot, "list", timeout=timeout) as connection:
        devices = connection.devices()
    if json:
        common.print_json([{"device": device.address, "driver": device.driver} for device in devices])
        return
    common.show(common.table(["DEVICE", "DRIVER"], [(device.address, device.driver) for device in devices]))


def info(
    device: DeviceArgument, robot: RobotOption = LOCALHOST, json: JsonOption = False, timeout: TimeoutOption = 2.0
) -> None:
    """Tell what a device is.

    Its driver, where it is on the robot, who drives it, how often it speaks."""
    name = common.parse_device(device)
    with common.connect(robot, "info", timeout=timeout) as connection:
        connection.record()
        proxy = connection.device(name)
        told: dict[str, Any] = {"device": name, "driver": proxy.driver}
        motion = proxy.motion()
        if motion is not None:
            told |= {"state": common.state_name(motion.state), "owner": motion.owner, "reason": motion.reason}
        for request in recording.descriptions(name.partition(":")[0]):
            try:
                told[type(request).NAME] = proxy.request(request).to_dict()
            except regista.RefusedError:
                continue
        told |= _rates(connection, seconds=1.0)
    if json:
        common.print_json(told)
        return
    grid = Table.grid(padding=(0, 2))
    for key, value in told.items():
        grid.add_row(key, recording.text(value) if isinstance(value, dict) else str(value))
    common.show(grid)


def _rates(connection: regista.Robot, seconds: float) -> dict[str, Any]:
    """Of each data message, how many came in a second."""
    counts: dict[str, int] = {}
    for received in common.messages(connection, until=time.monotonic() + seconds):
        counts[type(received.message).NAME] = counts.get(type(received.message).NAME, 0) + 1
    return {"rates_hz": {name: round(count / seconds, 1) for name, count in counts.items()}}


def print_device(
    device: DeviceArgument,
    robot: RobotOption = LOCALHOST,
    json: JsonOption = False,
    rate: Annotated[
        float | None, typer.Option("--rate", "-p", min=0.01, metavar="HZ", help="At most so many a second, the newest.")
    ] = None,
    count: Annotated[int | None, typer.Option("--count", "-n", metavar="N", min=1, help="End after so many.")] = None,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Print what a device says, until Ctrl-C."""
    name = common.parse_device(device)
    with common.connect(robot, "print", timeout=timeout) as connection:
        connection.record()
        connection.device(name)
        printed, next_at = 0, time.monotonic()
        deadline = time.monotonic() + timeout
        newest: regista.Received | None = None
        while count is None or printed < count:
            wait_until = deadline if newest is None else min(deadline, next_at)
            for received in common.messages(connection, until=wait_until, first=True):
                newest = received
                deadline = time.monotonic() + timeout
                if rate is None:
                    printed += _print_message(received, json)
                    newest = None
                    if count is not None and printed >= count:
                        return
            now = time.monotonic()
            if newest is not None and now >= next_at:
                printed += _print_message(newest, json)
                newest = None
                next_at = max(next_at + 1 / (rate or 1), now)
            if now >= deadline:
                common.fail(
                    common.TIMEOUT,
                    f"{name} at {robot} said nothing for {common.duration(timeout)}; is its driver open? "
                    "Try: regista doctor",
                )


def _print_message(received: regista.Received, json: bool) -> int:
    kind = type(received.message)
    if json:
        fields = {"device": received.device, "message": kind.NAME, "stamp": received.stamp}
        common.print_json({**fields, **recording.write(received.message)})
    else:
        common.console.print(f"{received.stamp:.3f} {kind.NAME} {recording.text(recording.write(received.message))}")
    return 1


def status(
    robot: RobotOption = LOCALHOST,
    json: JsonOption = False,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Again and again, until Ctrl-C.")] = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Show drivers, who drives, and why it stands.

    Also the beats that each driver missed, and how often it failed."""
    _show(robot, "status", drivers_table, json, watch, timeout)


def clients(
    robot: RobotOption = LOCALHOST,
    json: JsonOption = False,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Again and again, until Ctrl-C.")] = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Show who is connected.

    Name, priority, what waits for it, what was dropped because it reads too slowly."""
    _show(robot, "clients", clients_table, json, watch, timeout)


def _show(robot: str, verb: str, render: Any, json: bool, watch: bool, timeout: float) -> None:
    with common.connect(robot, verb, timeout=timeout) as connection:

        def ask() -> dict[str, Any]:
            return connection.status()

        if json:
            while True:
                told = ask()
                common.print_json(told["clients"] if verb == "clients" else told)
                if not watch:
                    return
                common.wait(connection, 1.0)
        if not watch:
            common.show(render(ask()))
            return
        with Live(render(ask()), console=common.console, auto_refresh=False) as live:
            while True:
                common.wait(connection, 0.5)
                live.update(render(ask()), refresh=True)


def clients_table(told: dict[str, Any]) -> Table:
    columns = ["NAME", "PEER", ">PRIORITY", "SPEAKS", "MODE", ">DEVICES", ">PENDING", ">IN", ">OUT", ">DROPPED"]
    return common.table(
        columns,
        [
            (
                client["name"] or "-",
                client["peer"],
                client["priority"],
                "regista" if client["extended"] else "player",
                client["mode"],
                client["devices"],
                f"{client['pending_bytes']} B",
                client["messages_in"],
                client["messages_out"],
                client["data_dropped"],
            )
            for client in told["clients"]
        ],
    )


def drivers_table(told: dict[str, Any]) -> Table:
    rows = []
    for driver in told["drivers"]:
        state = "HUNG" if driver["hung"] else "open" if driver["open"] else "closed"
        own = (driver["name"], state, f"{driver['rate_hz']:g} Hz", driver["beats_missed"], driver["faults"])
        for device in driver["devices"]:
            for group in device["motion"] or [None]:
                rows.append((*own, device["device"], *_motion_cells(group)))
    columns = ["DRIVER", "STATE", ">RATE", ">MISSED", ">FAULTS", "DEVICE", "GROUP", "MOTION", "DRIVEN BY", "REASON"]
    shown = common.table(columns, rows)
    shown.title = f"regista-server {told['version']}, up {common.duration(told['uptime_s'])}"
    shown.title_justify = "left"
    return shown


def _motion_cells(group: dict[str, Any] | None) -> tuple[str, ...]:
    if group is None:
        return "-", "-", "-", ""
    owner = f"{group['owner']} (prio {group['owner_priority']})" if group["owner"] else "nobody"
    return group["group"], group["state"], owner, group["reason"]


def add_to(app: typer.Typer) -> None:
    app.command("list", epilog=examples("regista list", "regista list --robot robot7:6665 --json"))(list_devices)
    app.command("info", epilog=examples("regista info position2d:0"))(info)
    app.command(
        "print",
        epilog=examples(
            "regista print position2d",
            "regista print power --rate 0.2",
            "regista print position2d --json --count 1 | jq .pose.x",
        ),
    )(print_device)
    app.command("status", epilog=examples("regista status", "regista status --watch"))(status)
    app.command("clients", epilog=examples("regista clients", "regista clients --json | jq '.[].name'"))(clients)
