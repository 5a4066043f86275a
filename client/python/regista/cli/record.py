# SPDX-License-Identifier: Apache-2.0
"""`regista record`: what a robot says, into an MCAP file."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress, TextColumn, TimeElapsedColumn

import regista

from .. import recording
from ..recording import Log, Recorder
from . import common
from .common import RobotOption, TimeoutOption, examples
from .drive import ends_on_signals
from .look import LOCALHOST


def record(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Such as lap.mcap.")],
    devices: Annotated[
        list[str] | None, typer.Argument(metavar="DEVICE", help="Only these; default: all of the robot.")
    ] = None,
    robot: RobotOption = LOCALHOST,
    seconds: Annotated[float | None, typer.Option("--for", min=0.1, metavar="S", help="End after so long [s].")] = None,
    force: Annotated[bool, typer.Option("--force", "-f", help="Overwrite the file.")] = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Record what the robot says, until Ctrl-C.

    Into an MCAP file that Foxglove, Lichtblick and PlotJuggler open.

    The file can be read at any time, also after a power cut: all but the last second is there. A full disk stops the
    recording, and it goes on when there is space. Recording opens the devices, as every client does."""
    with common.connect(robot, "record", timeout=timeout, reconnect=True) as connection:
        names = [common.parse_device(name) for name in devices or []] or [d.address for d in connection.devices()]
        if not names:
            common.fail(common.FAILED, f"{robot} has no devices")
        connection.record()
        answers = open_devices(connection, names, needed=bool(devices))
        try:
            recorder = Recorder(file, overwrite=force, on_notice=common.note)
        except FileExistsError:
            common.fail(common.FAILED, f"{file} is already there; choose another name, or --force to overwrite it")
        try:
            log = Log(recorder)
            for answer in answers:
                log.answer(*answer)
            with ends_on_signals(), contextlib.suppress(KeyboardInterrupt):
                _loop(connection, recorder, log, seconds)
        finally:
            trouble = recorder.close()
        dropped = recorder.dropped + connection.counters()["overflows"]
    summary = f"{file}: {recorder.written} messages, {recorder.size} bytes, {dropped} dropped"
    if trouble is not None:
        common.fail(common.FAILED, f"{summary}; the end is missing: {trouble.strerror}")
    common.note(summary)


def open_devices(connection: regista.Robot, names: list[str], *, needed: bool) -> list[tuple[str, Any, Any]]:
    """Subscribe, and ask each device what it is: the devices, questions and answers. Those that refuse are left out,
    unless they are needed."""
    answers = []
    for name in names:
        try:
            proxy = connection.device(name)
        except regista.RefusedError as error:
            if needed:
                raise
            common.note(f"not recorded: {error}")
            continue
        for request in recording.descriptions(name.partition(":")[0]):
            with contextlib.suppress(regista.RefusedError):
                answers.append((name, request, proxy.request(request)))
    return answers


def _loop(connection: regista.Robot, recorder: Recorder, log: Log, seconds: float | None) -> None:
    began = time.monotonic()
    end = None if seconds is None else began + seconds
    columns = (TextColumn("recording"), TimeElapsedColumn(), TextColumn("{task.fields[counts]}"))
    with Progress(*columns, console=common.stderr, transient=True, disable=not common.stderr.is_terminal) as progress:
        task = progress.add_task("", total=None, counts="")
        while end is None or time.monotonic() < end:
            until = time.monotonic() + 0.25
            for received in common.messages(connection, until=until if end is None else min(until, end)):
                log.data(received)
            for event in connection.events():
                log.event(event)
            counts = f"{recorder.written} messages, {recorder.size / 1e6:.2f} MB, {recorder.dropped} dropped"
            progress.update(task, counts=counts)


def add_to(app: typer.Typer) -> None:
    app.command(
        "record", epilog=examples("regista record lap.mcap", "regista record lap.mcap position2d power --for 60")
    )(record)
