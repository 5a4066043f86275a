# SPDX-License-Identifier: Apache-2.0
"""What the verbs share: the robot's address, the connection, what is printed where."""

from __future__ import annotations

import contextlib
import getpass
import ipaddress
import json
import os
import socket
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.table import Table

import regista
from regista import _core

OK, FAILED, USAGE, CANNOT_CONNECT, REFUSED, TIMEOUT, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
PORT = 6665
PEOPLE = 20  # priority of what a person does by hand; programs have 10

# Tables are as wide as they need to be when nobody looks: a pipe has no width.
_wide = None if sys.stdout.isatty() else 10_000


class _Console(Console):
    def on_broken_pipe(self) -> None:
        raise BrokenPipeError  # for quiet_pipe, instead of ending with 1


console = _Console(highlight=False, soft_wrap=not sys.stdout.isatty(), width=_wide)
stderr = Console(stderr=True, highlight=False, soft_wrap=True)

RobotOption = Annotated[
    str,
    typer.Option(
        "--robot", "-r", metavar="HOST[:PORT]", envvar="REGISTA_ROBOT", help=f"Which robot; port {PORT} unless it says."
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="JSON on standard output, one object a line where it repeats.")
]
TimeoutOption = Annotated[
    float, typer.Option("--timeout", min=0.05, max=600, metavar="S", help="How long to wait for each answer [s].")
]


def fail(code: int, text: str) -> NoReturn:
    """End the program; `text` names the thing, the place and the remedy."""
    stderr.print(f"regista: {text}", style="red" if code != OK else None, markup=False)
    raise typer.Exit(code)


def note(text: str) -> None:
    """For the person, not for the pipe."""
    stderr.print(text, markup=False)


def parse_robot(text: str, what: str = "--robot") -> tuple[str, int]:
    """HOST, HOST:PORT, [IPv6]:PORT, or an IPv6 address; `what` it is, for the words that refuse it."""
    host, port = text, ""
    if text.startswith("["):
        host, bracket, rest = text[1:].partition("]")
        if not bracket or (rest and not rest.startswith(":")):
            fail(USAGE, f"{what} {text!r}: write an IPv6 address with a port as [::1]:{PORT}")
        port = rest[1:]
    elif text.count(":") == 1:
        host, _, port = text.partition(":")
    if not host or any(c.isspace() or c in "/@?#" for c in text):
        fail(USAGE, f"{what} {text!r}: that is no host; write HOST[:PORT], such as localhost:{PORT}")
    if ":" in host and not _is_ipv6(host):
        fail(USAGE, f"{what} {text!r}: too many colons; write HOST[:PORT], or an IPv6 address as [::1]:{PORT}")
    if (port and not port.isdecimal()) or not 0 < int(port or PORT) < 65536:
        fail(USAGE, f"{what} {text!r}: the port must be a number from 1 to 65535")
    return host, int(port or PORT)


def _is_ipv6(host: str) -> bool:
    try:
        return bool(ipaddress.IPv6Address(host))
    except ValueError:
        return False


def connect(robot: str, verb: str, *, timeout: float = 2.0, priority: int = 10, **options: Any) -> regista.Robot:
    """Connected, under the verb's name; others see "drive ann@laptop" in `regista clients`."""
    host, port = parse_robot(robot)
    with contextlib.suppress(OSError, KeyError):
        verb = f"{verb} {getpass.getuser()}"
    robot_name = f"{verb}@{socket.gethostname()}"[:63]
    return regista.Robot(host, port, timeout=timeout, name=robot_name, priority=priority, **options)


def parse_device(text: str) -> str:
    """ "position2d" is "position2d:0"."""
    name, colon, index = text.partition(":")
    if not name or (colon and not index.isdecimal()):
        fail(USAGE, f"device {text!r}: write INTERFACE:INDEX, such as position2d:0; `regista list` names them")
    device = f"{name}:{int(index or 0)}"
    try:
        _core.device_code(device)
    except ValueError as error:
        fail(USAGE, f"{error}; `regista list` names what there is")
    return device


def index_of(name: str, interface: str) -> int:
    """3, of "position2d:3"."""
    given, _, index = name.partition(":")
    if given != interface:
        fail(USAGE, f"{name} is no {interface}; `regista list` names what there is")
    return int(index)


def state_name(state: int) -> str:
    """Of a motion: "driving"; a newer server may have states that we do not know."""
    return getattr(state, "name", str(state))


def print_json(value: Any) -> None:
    """One line, at once: we may stand in a pipe."""
    sys.stdout.write(json.dumps(value, separators=(", ", ": "), default=str) + "\n")
    sys.stdout.flush()


def table(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> Table:
    shown = Table(box=None, pad_edge=False, header_style="bold", show_edge=False)
    for column in columns:
        shown.add_column(column, justify="right" if column.startswith(">") else "left", no_wrap=not sys.stdout.isatty())
        shown.columns[-1].header = column.lstrip(">")
    for row in rows:
        shown.add_row(*(str(cell) for cell in row))
    return shown


def show(renderable: Any) -> None:
    """On standard output; without the blanks at the ends of lines that a table has, when nobody looks."""
    if console.is_terminal:
        console.print(renderable)
        return
    with console.capture() as capture:
        console.print(renderable)
    sys.stdout.write("".join(line.rstrip() + "\n" for line in capture.get().splitlines()))


@contextlib.contextmanager
def quiet_pipe() -> Iterator[None]:
    """Whoever reads our output may have enough of it: that is no failure."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still buffered has nowhere to go
        raise typer.Exit(OK) from None


def duration(seconds: float) -> str:
    """850 µs, 12 ms, 3.4 s, 2 h 5 min"""
    if seconds < 1e-3:
        return f"{seconds * 1e6:.0f} µs"
    if seconds < 1:
        return f"{seconds * 1e3:.3g} ms"
    if seconds < 120:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def examples(*lines: str) -> str:
    """For the epilog of a verb."""
    return "\b\nExamples:\n" + "\n".join("  " + line for line in lines)


def messages(connection: regista.Robot, *, until: float, first: bool = False) -> Iterator[regista.Received]:
    """The data that come until that time of the monotonic clock; with `first`, only until some have come.

    After `connection.record()`."""
    while (left := until - time.monotonic()) > 0:
        connection.read(timeout=left)
        some = False
        for received in connection.messages():
            some = True
            yield received
        if first and some:
            return


def wait(connection: regista.Robot, seconds: float) -> None:
    """Without losing the connection: its own keep-alives and time-outs go on."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        connection.read(timeout=left)
