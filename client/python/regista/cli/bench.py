# SPDX-License-Identifier: Apache-2.0
"""`regista bench`: how long a question to this server takes."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer
from rich.progress import track

from . import common
from .common import JsonOption, RobotOption, TimeoutOption, examples
from .look import LOCALHOST

# A question of 40 bytes, DEVLIST to player:0, as PLAYER sends it (docs/protocol.md), and how an answer tells its size.
HEADER = 40
QUESTION = bytes.fromhex("00000000 00000000 00000001 00000000 00000003 00000001".replace(" ", "")) + bytes(16)


def quantiles(durations: list[float]) -> dict[str, float]:
    """p50, p99 and the longest [µs]."""
    ordered = sorted(durations)
    pick = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    last = len(ordered) - 1
    return {name: round(1e6 * ordered[min(last, int(share * len(ordered)))], 1) for name, share in pick.items()}


def measure(ask: Callable[[], object], count: int, what: str) -> list[float]:
    """How long each call took [s]."""
    durations = []
    for _ in range(min(count, 20)):
        ask()  # warm
    for _ in track(range(count), what, console=common.stderr, transient=True, disable=not common.stderr.is_terminal):
        begin = time.perf_counter()
        ask()
        durations.append(time.perf_counter() - begin)
    return durations


def exactly(stream: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        more = stream.recv(size - len(data))
        if not more:
            raise ConnectionError("the server closed the connection")
        data += more
    return data


@contextlib.contextmanager
def raw(host: str, port: int, timeout: float) -> Iterator[Callable[[], int]]:
    """The same question over a bare socket: what network and server take, without our client."""
    with socket.create_connection((host, port), timeout=timeout) as stream:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        exactly(stream, 32)  # the server's banner

        def ask() -> int:
            stream.sendall(QUESTION)
            while True:
                header = exactly(stream, HEADER)
                body = exactly(stream, int.from_bytes(header[36:40], "big"))
                if header[16:20] == b"\0\0\0\4":  # the ACK; anything else is data
                    return HEADER + len(body)

        yield ask


@contextlib.contextmanager
def echo(size: int) -> Iterator[Callable[[], object]]:
    """Bytes there and back over loopback TCP, to a thread that does nothing else: the floor on this machine."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        peer, _ = listener.accept()
        with peer:
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := peer.recv(65536):
                peer.sendall(data)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    with listener, socket.create_connection(listener.getsockname()) as stream:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        message = bytes(size)

        def ask() -> object:
            stream.sendall(message)
            return exactly(stream, size)

        yield ask
    thread.join()


def bench(
    robot: RobotOption = LOCALHOST,
    count: Annotated[int, typer.Option("--count", "-n", metavar="N", min=10, help="Questions.")] = 2000,
    json: JsonOption = False,
    timeout: TimeoutOption = 2.0,
) -> None:
    """Time round trips to the server.

    Beside the same bytes over bare TCP."""
    host, port = common.parse_robot(robot)
    results: dict[str, Any] = {}
    with common.connect(robot, "bench", timeout=timeout) as connection:
        questions = 1 + len(connection.devices())  # the list, and the driver of each
        durations = measure(connection.devices, count, "regista client")
        results["regista client"] = quantiles([each / questions for each in durations])
    with raw(host, port, timeout) as ask:
        size = ask()
        results["raw socket, same server"] = quantiles(measure(ask, count, "raw socket, same server"))
    with echo(size) as ask:
        results["TCP echo on this machine"] = quantiles(measure(ask, count, "TCP echo on this machine"))
    if json:
        common.print_json({name: {f"{key}_us": value for key, value in told.items()} for name, told in results.items()})
        return
    floor = results["raw socket, same server"]["p50"]
    rows = [
        (name, told["p50"], told["p99"], told["max"], f"{told['p50'] / floor:.2f}") for name, told in results.items()
    ]
    common.show(common.table(["ROUND TRIP", ">P50 µs", ">P99 µs", ">MAX µs", ">x RAW"], rows))


def add_to(app: typer.Typer) -> None:
    app.command("bench", epilog=examples("regista bench", "regista bench --robot robot7 --count 500"))(bench)
