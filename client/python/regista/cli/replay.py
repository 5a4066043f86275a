# SPDX-License-Identifier: Apache-2.0
"""`regista replay`: a recording looks like the robot that it was taken from."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated

import typer
from rich.progress import Progress, TextColumn, TimeRemainingColumn

import regista

from .. import recording
from ..recording import Record, Recording
from . import common
from .common import examples
from .drive import ends_on_signals

START_SECONDS = 20.0


@dataclass(frozen=True)
class Cut:
    """Which part of a recording is played, and how fast."""

    start: float = 0.0  # s after its first message
    end: float | None = None
    rate: float = 1.0


def data_records(source: Recording, cut: Cut) -> Iterator[tuple[float, Record]]:
    """What is to be played, and where in the recording: seconds after its first data."""
    first: int | None = None
    for record in source:
        if record.metadata.get("kind") != "data":
            continue
        first = record.log_time_ns if first is None else first
        seconds = (record.log_time_ns - first) * 1e-9
        if cut.end is not None and seconds > cut.end:
            return
        if seconds >= cut.start:
            yield seconds, record


def answers(source: Recording) -> Iterator[Record]:
    return (record for record in source if record.metadata.get("kind") == "answer")


def frame(record: Record) -> bytes:
    """The message as it went over the wire."""
    interface, _, index = record.metadata["device"].partition(":")
    subtype = int(record.metadata["subtype"])
    answer = record.metadata["kind"] == "answer"
    found = recording.answer_class if answer else recording.data_class
    kind = found(interface, subtype)
    if kind is None:
        raise ValueError(f"{record.topic}: this version of regista does not know message {subtype} of {interface}")
    message = recording.read(kind, record.message)
    return regista.wire.frame(message, f"{interface}:{index}", subtype, answer=answer)


def pace(records: Iterator[tuple[float, Record]]) -> Iterator[tuple[float, float, Record]]:
    """Hand on each record when its time has come: the time, how late it is by our fault [s], and the record."""
    began = time.monotonic()
    for offset, record in records:
        while (left := began + offset - time.monotonic()) > 0:
            time.sleep(left)
        yield offset, -left, record


@contextlib.contextmanager
def served(devices: list[str], port: int) -> Iterator[tuple[IO[bytes], str]]:
    """A regista-server that offers these devices: what its driver `playback` is fed with, and where it listens."""
    program = os.environ.get("REGISTA_SERVER") or shutil.which("regista-server")
    if program is None:
        common.fail(common.FAILED, "regista-server is not in PATH; install it, or name it in REGISTA_SERVER")
    names = " ".join(f'"{device}"' for device in devices)
    with tempfile.TemporaryDirectory(prefix="regista-replay-") as folder:
        config = Path(folder, "replay.cfg")
        config.write_text(f'driver ( name "playback" provides [{names}] alwayson yes )\n')
        server = subprocess.Popen(
            [program, "--port", str(port), "--log-level", "error", config],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for us; the server ends when we are through
            preexec_fn=_die_with_parent,
        )
        assert server.stdin is not None and server.stdout is not None
        try:
            ready = server.stdout.readline().decode()
            if not ready.startswith("regista-server: ready on "):
                common.fail(common.FAILED, f"{program} did not start (exit code {server.wait()})")
            yield server.stdin, ready.split()[-1]
        finally:
            server.terminate()
            try:
                server.wait(START_SECONDS)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()
            with contextlib.suppress(BrokenPipeError):
                server.stdin.close()
            server.stdout.close()


def _die_with_parent() -> None:
    set_death_signal = 1  # PR_SET_PDEATHSIG, prctl(2)
    ctypes.CDLL(None).prctl(set_death_signal, signal.SIGTERM)


def refuse_beside_live(port: int, sim: bool) -> None:
    """Two robots with the same names are one too many: people look at the one and drive the other."""
    for beside in dict.fromkeys((port, common.PORT)):
        if beside == 0 or (sim and beside != port):
            continue
        try:
            with regista.Robot("localhost", beside, timeout=1.0, name="replay") as live:
                devices = ", ".join(f"{device.address} ({device.driver})" for device in live.devices())
        except regista.Error:
            continue
        choice = (
            "choose another port with --port" if beside == port and sim else "stop it, or, if nothing there moves, "
        )
        if not (beside == port and sim):
            choice += f"replay beside it with --sim --port {port + 1 if beside == port else port}"
        common.fail(common.REFUSED, f"localhost:{beside} is a server with live devices: {devices}; {choice}")


def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An MCAP file of `regista record`.")],
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Where to serve; 0: any free one.")
    ] = common.PORT,
    rate: Annotated[float, typer.Option("--rate", min=0.01, max=1000, metavar="X", help="2: twice as fast.")] = 1.0,
    start: Annotated[float, typer.Option("--start", min=0, metavar="S", help="Begin there [s].")] = 0.0,
    end: Annotated[float | None, typer.Option("--end", min=0, metavar="S", help="End there [s].")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="Begin when the first client has subscribed.")] = False,
    sim: Annotated[bool, typer.Option("--sim", help="Also beside another server on this machine.")] = False,
    to: Annotated[
        str | None,
        typer.Option("--to", metavar="HOST[:PORT]", help="Instead, drive the bases of this robot as recorded."),
    ] = None,
    move: Annotated[bool, typer.Option("--move", help="With --to: yes, it shall move.")] = False,
    steer: Annotated[
        bool, typer.Option("--steer", help='Take {"at": S}, {"rate": X} on standard input, a line each; 0 pauses.')
    ] = False,
) -> None:
    """Serve a recording as if it were the robot.

    Clients see the recorded devices, values and times. Commands are refused, as nothing moves. With --to, the recorded
    velocities are sent to a robot instead."""
    source = Recording(file)
    cut = Cut(start, end, rate)
    devices = sorted({record.metadata["device"] for _, record in data_records(source, Cut())})
    if not devices:
        common.fail(common.FAILED, f"{file} holds no data of devices; was it made by `regista record`?")
    with ends_on_signals():
        if to is None:
            refuse_beside_live(port, sim)
            _serve(source, cut, devices, port, loop, wait, steer)
        else:
            _drive(source, cut, devices, to, move, loop)
    if not source.complete:
        common.note(f"{file} ends in the middle; played is what came before")


def _rounds(source: Recording, cut: Cut, loop: bool) -> Iterator[tuple[float, float, Record]]:
    """Paced, and with --loop again and again."""
    # No collection between two records: it would come late.
    gc.collect()
    gc.disable()
    try:
        while True:
            played = False
            for item in pace(((at - cut.start) / cut.rate, record) for at, record in data_records(source, cut)):
                played = True
                yield item
            if not played:
                common.fail(common.USAGE, f"nothing was recorded between --start {cut.start} and --end {cut.end}")
            if not loop:
                return
    finally:
        gc.enable()


@contextlib.contextmanager
def _progress(source: Recording, cut: Cut) -> Iterator[Progress]:
    _, first, last = source.span()
    seconds = (last - first) * 1e-9
    total = (min(seconds, cut.end or seconds) - cut.start) / cut.rate
    columns = (*Progress.get_default_columns()[:3], TimeRemainingColumn(), TextColumn("{task.fields[count]} messages"))
    with Progress(*columns, console=common.stderr, transient=True, disable=not common.stderr.is_terminal) as progress:
        progress.add_task("replaying", total=max(total, 0.0), count=0)
        yield progress


def _serve(source: Recording, cut: Cut, devices: list[str], port: int, loop: bool, wait: bool, steer: bool) -> None:
    with served(devices, port) as (feed, endpoint):
        for record in answers(source):
            feed.write(frame(record))
        feed.flush()
        common.note(f"serving {', '.join(devices)} on {endpoint}")
        if wait:
            _wait_for_client(endpoint, steer)
        if steer:
            with _server_lives():
                for record in Steered(source, cut):
                    feed.write(frame(record))
                    feed.flush()
            return
        count, shown, latest = 0, 0.0, 0.0
        with _progress(source, cut) as progress, _server_lives():
            for offset, late, record in _rounds(source, cut, loop):
                feed.write(frame(record))
                feed.flush()
                count += 1
                latest = max(latest, late)
                if not progress.disable and time.monotonic() - shown > 0.2:
                    shown = time.monotonic()
                    progress.update(progress.task_ids[0], completed=offset, count=count)
    common.note(f"{count} messages, at most {common.duration(latest)} late")


class Steered:
    """The records of a recording in their time, as standard input says: each line an object with `at`, go there [s],
    `rate`, so fast, 0 for a pause, or both. Ends with the input.

    At the end of the recording it waits there. Standard output says ten times a second where it is.
    """

    TELL_SECONDS = 0.1
    GLIMPSE_SECONDS = 0.5  # of a recording, shown at once where somebody looks: what is there

    def __init__(self, source: Recording, cut: Cut) -> None:
        _, first, last = source.span()
        self._source = source
        self._length = min((last - first) * 1e-9, cut.end if cut.end is not None else float("inf"))
        self._rate = cut.rate
        self._orders = b""
        self._next: tuple[float, Record] | None
        self._go_to(cut.start)

    def __iter__(self) -> Iterator[Record]:
        told = 0.0
        while True:
            now = time.monotonic()
            if now - told >= self.TELL_SECONDS:
                told = now
                where = {"at": round(self._at(now), 3), "length": round(self._length, 3), "rate": self._rate}
                print(json.dumps(where), flush=True)
            wait = told + self.TELL_SECONDS - now
            if self._next is not None and self._next[0] <= self._shown:
                wait = 0.0
            elif self._next is not None and self._rate > 0 and self._at(now) < self._length:
                wait = min(wait, (self._next[0] - self._at(now)) / self._rate)
            if select.select([0], [], [], max(wait, 0.0))[0] and not self._obey():
                return
            if self._next is not None and self._next[0] <= max(self._at(time.monotonic()), self._shown):
                yield self._next[1]
                self._next = next(self._records, None)

    def _at(self, now: float) -> float:
        return min(self._from + (now - self._since) * self._rate, self._length)

    def _go_to(self, at: float) -> None:
        at = min(max(at, 0.0), self._length)
        begin = max(at - self.GLIMPSE_SECONDS, 0.0)
        self._records = data_records(self._source, Cut(begin))
        self._next = next(self._records, None)
        # Now: what is far behind in the file took a while to find.
        self._from, self._since, self._shown = at, time.monotonic(), at

    def _obey(self) -> bool:
        """False: nobody gives orders any more."""
        said = os.read(0, 4096)
        *lines, self._orders = (self._orders + said).split(b"\n")
        for line in lines:
            order = json.loads(line)
            now = time.monotonic()
            self._from, self._since = self._at(now), now
            self._rate = min(max(float(order.get("rate", self._rate)), 0.0), 1000.0)
            if "at" in order:
                self._go_to(float(order["at"]))
        return bool(said)


@contextlib.contextmanager
def _server_lives() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        common.fail(common.FAILED, "regista-server has ended before the recording")


def _wait_for_client(endpoint: str, steered: bool) -> None:
    """Or, when it is steered, until nobody can give orders any more."""
    host, port = common.parse_robot(endpoint)
    orders = select.poll()
    if steered:
        orders.register(0, 0)  # tells only whether the other end is closed
    with regista.Robot(host, port, name="replay") as own:
        while not any(d["subscribers"] for driver in own.status()["drivers"] for d in driver["devices"]):
            if orders.poll(0):
                return
            common.wait(own, 0.02)


def _drive(source: Recording, cut: Cut, devices: list[str], to: str, move: bool, loop: bool) -> None:
    bases = [device for device in devices if device.startswith("position2d:")]
    if not bases:
        common.fail(common.FAILED, f"{source.path} holds no position2d, and nothing else can be driven as recorded")
    if not move:
        common.fail(
            common.REFUSED, f"this would move {', '.join(bases)} of {to}; if that is what you want, say --move as well"
        )
    with common.connect(to, "replay") as connection, _progress(source, cut) as progress:
        proxies = {name: connection.position2d(int(name.partition(":")[2])) for name in bases}
        try:
            for offset, _, record in _rounds(source, cut, loop):
                base = proxies.get(record.metadata["device"])
                if base is None or "velocity" not in record.message:
                    continue
                velocity = record.message["velocity"]
                base.set_velocity(x=velocity["x"], y=velocity["y"], w=velocity["w"])
                connection.read(timeout=0)
                for event in connection.events():
                    if " refused: " in event.text:
                        common.fail(common.REFUSED, event.text)
                progress.update(progress.task_ids[0], completed=offset)
        finally:
            for base in proxies.values():
                with contextlib.suppress(regista.Error):
                    base.release()


def add_to(app: typer.Typer) -> None:
    app.command(
        "replay",
        epilog=examples(
            "regista replay lap.mcap",
            "regista replay lap.mcap --rate 2 --start 10 --end 20 --loop",
            "regista replay lap.mcap --sim --port 7000    # beside another server",
            "regista replay lap.mcap --to robot7 --move   # robot7 drives what was recorded",
        ),
    )(replay)
