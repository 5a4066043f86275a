# SPDX-License-Identifier: Apache-2.0
"""`regista teleop`: robots on a web page."""

from __future__ import annotations

import asyncio
import contextlib
import getpass
import signal
import socket
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import common
from .common import examples

if TYPE_CHECKING:
    from ..teleop.live import Foxglove


def teleop(
    robots: Annotated[
        list[str] | None,
        typer.Argument(metavar="HOST[:PORT]", envvar="REGISTA_ROBOT", help="Which robots.  [default: localhost:6665]"),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, metavar="PORT", help="Where the page is; 0: any free one.")
    ] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    vision: Annotated[
        str | None,
        typer.Option("--vision", metavar="HOST:PORT", help="Show field and ball: the vision bridge's status_port."),
    ] = None,
    folder: Annotated[
        Path, typer.Option("--recordings", metavar="FOLDER", help="Where recordings are written and played from.")
    ] = Path(),
    foxglove: Annotated[
        int | None,
        typer.Option(
            "--foxglove",
            min=0,
            max=65535,
            metavar="PORT",
            help="The same data for Foxglove and Lichtblick: usually 8765; 0: any free one.",
        ),
    ] = None,
) -> None:
    """Drive robots from a web page, with keys, a gamepad, fingers or the mouse.

    Serves a page on this computer, to this computer only, and prints its address. Nothing moves unless something is
    held, or a destination was given while somebody watches. Robots may come and go.

    Wants the extra: pip install 'regista[teleop]'."""
    try:
        import uvloop
    except ModuleNotFoundError:
        common.fail(common.FAILED, "teleop wants packages that are not installed: pip install 'regista[teleop]'")
    from ..teleop import PAGE

    if not (PAGE / "index.html").is_file():
        common.fail(
            common.FAILED,
            "this package was built without its page: apt install nodejs npm, and install it again without "
            "REGISTA_PAGE=OFF (docs/teleop.md)",
        )
    addresses = [(text, *common.parse_robot(text, "robot")) for text in robots or [f"localhost:{common.PORT}"]]
    for i, (text, *address) in enumerate(addresses):
        if address in [list(other[1:]) for other in addresses[:i]]:
            common.fail(common.USAGE, f"robot {text!r} is named twice")
    if vision is not None:
        common.parse_robot(vision, "--vision")
    live = None if foxglove is None else _open_foxglove(foxglove)
    uvloop.run(_serve(addresses, port, browser, vision, folder, live))


def _open_foxglove(port: int) -> Foxglove:
    try:
        from ..teleop.live import Foxglove
    except ModuleNotFoundError:
        common.fail(common.FAILED, "--foxglove wants a package that is not installed: pip install 'regista[foxglove]'")
    try:
        live = Foxglove(port)
    except OSError as error:
        common.fail(common.FAILED, f"{error}; choose another port with --foxglove")
    common.note(f"Foxglove, Lichtblick: open a connection, Foxglove WebSocket, {live.url}")
    return live


async def _serve(
    addresses: list[tuple[str, str, int]],
    port: int,
    browser: bool,
    vision: str | None,
    folder: Path,
    live: Foxglove | None,
) -> None:
    from ..teleop.gateway import Gateway

    name = "teleop"
    with contextlib.suppress(OSError, KeyError):
        name = f"teleop {getpass.getuser()}"
    gateway = Gateway(f"{name}@{socket.gethostname()}", folder, live)
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    await gateway.start(port)
    try:
        for label, host, robot_port in addresses:
            gateway.add(label, host, robot_port)
        if vision is not None:
            gateway.see(vision)
        sys.stdout.write(f"{gateway.url}\n")
        sys.stdout.flush()
        if browser:
            webbrowser.open(gateway.url)
        await ended.wait()
    finally:
        await gateway.close()


def add_to(app: typer.Typer) -> None:
    app.command(
        "teleop",
        epilog=examples(
            "regista teleop", "regista teleop robot1 robot2:6665", "regista teleop --no-browser --port 8080 robot1"
        ),
    )(teleop)
