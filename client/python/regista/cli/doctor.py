# SPDX-License-Identifier: Apache-2.0
"""`regista doctor`: is the robot well, and if not, why and what to do."""

from __future__ import annotations

import enum
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import typer

import regista

from . import common
from .common import JsonOption, RobotOption, TimeoutOption, examples
from .look import LOCALHOST


class Health(enum.Enum):
    OK = "OK"
    WARN = "WARN"
    ERROR = "ERROR"
    STALE = "STALE"  # it says nothing

    @property
    def style(self) -> str:
        return {"OK": "green", "WARN": "yellow", "ERROR": "bold red", "STALE": "bold magenta"}[self.value]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    health: Health
    thing: str
    reason: str
    remedy: str = ""


MISSED_SHARE = 0.01  # of the beats
PENDING_BYTES = 64 * 1024  # a quarter of what a client may have waiting
LOW_CHARGE = 20.0  # percent
CLOCK_OFFSET = 1.0  # s
SILENT_PERIODS = 5  # of the driver's beat
SILENT_SECONDS = 1.0  # at least: slower machines are no illness


def examine(status: dict[str, Any]) -> Iterator[Finding]:
    """What the server's own status tells."""
    yield Finding(Health.OK, "server", f"version {status['version']}, up {common.duration(status['uptime_s'])}")
    if status["clients_refused"]:
        yield Finding(
            Health.WARN, "server", f"{status['clients_refused']} clients refused", "raise max_clients in the .cfg"
        )
    for client in status["clients"]:
        yield from _examine_client(client)
    for driver in status["drivers"]:
        yield from _examine_driver(driver)


def _examine_client(client: dict[str, Any]) -> Iterator[Finding]:
    thing = f"client {client['name'] or client['peer']}"
    if client["pending_bytes"] > PENDING_BYTES:
        yield Finding(
            Health.WARN,
            thing,
            f"reads too slowly: {client['pending_bytes']} bytes wait for it",
            "let it read faster, or in PULL mode",
        )
    if client["data_dropped"]:
        yield Finding(Health.WARN, thing, f"{client['data_dropped']} messages dropped: it reads too slowly")


def _examine_driver(driver: dict[str, Any]) -> Iterator[Finding]:
    thing = f"driver {driver['name']}"
    if driver["hung"]:
        yield Finding(Health.ERROR, thing, "hangs in a call", "see the server's log; hang_exit restarts it")
    faulty = [group for device in driver["devices"] for group in device["motion"] if group["state"] == "fault"]
    if faulty:
        yield Finding(
            Health.ERROR, thing, f"fault: {faulty[0]['reason']}", "it is opened again by itself, with back-off"
        )
    elif driver["faults"] and not driver["open"] and any(device["subscribers"] for device in driver["devices"]):
        yield Finding(Health.ERROR, thing, f"does not open; failed {driver['faults']} times", "see the server's log")
    elif driver["faults"]:
        yield Finding(Health.WARN, thing, f"failed {driver['faults']} times since the server started")
    if driver["beats"] and driver["beats_missed"] > MISSED_SHARE * driver["beats"]:
        share = 100 * driver["beats_missed"] / driver["beats"]
        yield Finding(
            Health.WARN,
            thing,
            f"misses {share:.0f} % of its beats",
            "lower its rate, or look what else the machine does",
        )
    if driver["queues"]["down_refused"]:
        yield Finding(Health.WARN, thing, f"{driver['queues']['down_refused']} messages found its queue full")
    if driver["open"] and not faulty and not driver["hung"]:
        yield Finding(Health.OK, thing, f"open, {driver['rate_hz']:g} Hz, {driver['beats']} beats")
    elif not driver["open"] and not driver["faults"]:
        yield Finding(Health.OK, thing, "closed: nobody uses it")
    for device in driver["devices"]:
        for group in device["motion"]:
            if group["owner"]:
                yield Finding(Health.OK, f"{device['device']} {group['group']}", f"driven by {group['owner']}")
            elif group["state"] != "fault" and group["reason"]:
                yield Finding(Health.OK, f"{device['device']} {group['group']}", f"{group['state']}: {group['reason']}")


def silent_after(rate_hz: float) -> float:
    """How long a device of a driver with this beat may say nothing [s]."""
    return max(SILENT_SECONDS, SILENT_PERIODS / rate_hz if rate_hz > 0 else SILENT_SECONDS)


def listen(connection: regista.Robot, status: dict[str, Any]) -> Iterator[Finding]:
    """Do the devices that are open say anything, and what? Closed ones are left closed."""
    patience = {
        device["device"]: silent_after(driver["rate_hz"])
        for driver in status["drivers"]
        if driver["open"] and driver["rate_hz"] > 0
        for device in driver["devices"]
    }
    connection.record()
    for name in patience:
        connection.device(name)
    began, silent, offset = time.monotonic(), dict(patience), 0.0
    while silent and (until := began + max(silent.values())) > time.monotonic():
        for received in common.messages(connection, until=until, first=True):
            silent.pop(received.device, None)
            here = time.time() - (time.monotonic() - received.arrival)
            offset = max(offset, abs(here - received.stamp))
    for name in sorted(patience.keys() - silent.keys()):
        if name.startswith("power:"):
            yield from _examine_power(name, connection.power(int(name.partition(":")[2])))
    for name, waited in silent.items():
        yield Finding(Health.STALE, name, f"said nothing for {common.duration(waited)}", "see the server's log")
    if offset > CLOCK_OFFSET:
        yield Finding(
            Health.WARN, "clock", f"the robot's is {offset:.1f} s off ours", "synchronise both, for example with chrony"
        )


def _examine_power(name: str, power: regista.Power) -> Iterator[Finding]:
    percent = power.charge_percent
    if percent is None:
        return
    low = percent < LOW_CHARGE
    yield Finding(Health.WARN if low else Health.OK, name, f"charge {percent:.0f} %", "charge it" if low else "")


def doctor(robot: RobotOption = LOCALHOST, json: JsonOption = False, timeout: TimeoutOption = 2.0) -> None:
    """Find out whether the robot is well, and why not.

    OK, WARN, ERROR or STALE for each thing, with the reason and what to do about it. Ends with 1 when something is
    ERROR or STALE. Opens no device that is closed."""
    findings: list[Finding] = []
    with common.connect(robot, "doctor", timeout=timeout) as connection:
        began = time.monotonic()
        try:
            status = connection.status()
        except regista.RefusedError:
            names = ", ".join(device.address for device in connection.devices())
            findings.append(
                Finding(Health.WARN, "server", f"a stock Player server: it tells no health. Devices: {names}")
            )
        else:
            answer = time.monotonic() - began
            health = Health.WARN if answer > timeout / 4 else Health.OK
            findings.append(Finding(health, "connection", f"answers after {common.duration(answer)}"))
            findings += examine(status)
            findings += listen(connection, status)
    if json:
        common.print_json(
            [{"health": f.health.value, "thing": f.thing, "reason": f.reason, "remedy": f.remedy} for f in findings]
        )
    else:
        for finding in findings:
            remedy = f"; {finding.remedy}" if finding.remedy else ""
            common.console.print(f"[{finding.health.style}]{finding.health.value:5}[/]", end=" ")
            common.console.print(f"{finding.thing}: {finding.reason}{remedy}", markup=False)
    if any(finding.health in (Health.ERROR, Health.STALE) for finding in findings):
        raise typer.Exit(common.FAILED)


def add_to(app: typer.Typer) -> None:
    app.command("doctor", epilog=examples("regista doctor", "regista doctor --robot robot7 --json"))(doctor)
