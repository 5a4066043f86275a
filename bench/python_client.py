# SPDX-License-Identifier: Apache-2.0
"""What read() costs in Python, over the raw socket read in the same run.

python bench/python_client.py [--quick]

A server of this file sends states of position2d:0 over loopback from the same thread, so that each read finds its
messages there. Fails when a message costs more than 10 us over the raw read, or when 10,000 a second fall behind.
"""

from __future__ import annotations

import argparse
import json
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import regista

MOST_US = 10.0
RATE = 10_000


def pack(interface: int, kind: int, subtype: int, sequence: int, body: bytes) -> bytes:
    return struct.pack(">6IdII", 0, 0, interface, 0, kind, subtype, 0, sequence, len(body)) + body


def states(count: int) -> bytes:
    return b"".join(pack(4, 1, 1, 0, struct.pack(">6dI", i, 0, 0, 0, 0, 0, 0)) for i in range(1, count + 1))


class Server:
    """Greets one client and opens whatever it asks for; `send` is the benchmark's then."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self.listener.getsockname()[1])
        self.thread = threading.Thread(target=self._shake_hands, daemon=True)
        self.thread.start()

    def _shake_hands(self) -> None:
        self.peer, _ = self.listener.accept()
        self.peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.peer.sendall(b"Player v.3.1.1-dev".ljust(32, b"\0"))
        subtype = 0
        while subtype != 3:
            header = self.peer.recv(40, socket.MSG_WAITALL)
            interface, _, _, subtype, _, sequence, size = struct.unpack(">4IdII", header[8:])
            body = self.peer.recv(size, socket.MSG_WAITALL) if size else b""
            reply = body[:20] + struct.pack(">II", 1, 1) + bytes(4) if subtype == 3 else b""
            self.peer.sendall(pack(interface, 6 if subtype == 100 else 4, subtype, sequence, reply))


def connect() -> tuple[Server, regista.Robot, regista.Position2d]:
    server = Server()
    robot = regista.Robot("127.0.0.1", server.port)
    base = robot.position2d()
    server.thread.join()
    return server, robot, base


def best(rounds: int, batch: int, prepare: Callable[[], Callable[[], object]]) -> float:
    """[us] of a message: the median of many rounds."""
    once = prepare()
    times = []
    for _ in range(rounds):
        begin = time.perf_counter()
        once()
        times.append(time.perf_counter() - begin)
    return sorted(times)[len(times) // 2] / batch * 1e6


def measure(rounds: int, batch: int) -> dict[str, float]:
    data = states(batch)

    def raw() -> Callable[[], object]:
        server, robot, _ = connect()
        descriptor = socket.socket(fileno=socket.dup(robot.fileno()))
        buffer = bytearray(1 << 16)

        def once(server: Server = server, robot: regista.Robot = robot) -> None:
            server.peer.sendall(data)
            left = len(data)
            while left:
                left -= descriptor.recv_into(buffer)

        return once

    def ours() -> Callable[[], object]:
        server, robot, base = connect()
        wanted = 0

        def once(server: Server = server) -> None:
            nonlocal wanted
            server.peer.sendall(data)
            wanted += batch
            while base.count < wanted:
                robot.read(timeout=1)
                assert base.state.pose.x > 0

        return once

    return {"batch": batch, "raw_us": best(rounds, batch, raw), "robot_us": best(rounds, batch, ours)}


SENDER = """
import socket, sys, time
peer = socket.socket(fileno=int(sys.argv[1]))
data, rate, seconds = bytes.fromhex(sys.stdin.read()), int(sys.argv[2]), float(sys.argv[3])
peer.setblocking(True)
begin, sent, total = time.monotonic(), 0, int(rate * seconds)
while sent < total:
    due = min(total, int((time.monotonic() - begin) * rate))
    for _ in range(due - sent):
        peer.sendall(data)
    sent = max(sent, due)
    time.sleep(0.001)
"""


def keep_up(seconds: float) -> dict[str, float]:
    """RATE messages a second from another process, one by one, each of them looked at: when did the last come?"""
    server, robot, base = connect()
    robot.record()
    total = int(RATE * seconds)
    command = [sys.executable, "-c", SENDER, str(server.peer.fileno()), str(RATE), str(seconds)]
    sender = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, pass_fds=[server.peer.fileno()])
    assert sender.stdin is not None
    sender.stdin.write(states(1).hex())
    sender.stdin.close()
    seen = 0
    robot.read(timeout=20)
    begin, busy = time.monotonic(), time.thread_time()
    while base.count < total:
        robot.read(timeout=5)
        for message in robot.messages():
            seen += message.message.pose.x == 1  # type: ignore[attr-defined]
    elapsed, busy = time.monotonic() - begin, time.thread_time() - busy
    sender.wait()
    return {
        "messages": seen,
        "rate_hz": seen / elapsed,
        "late_s": elapsed - seconds,
        "busy_percent": 100 * busy / elapsed,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only see that it runs: no limits")
    quick = parser.parse_args().quick
    failures = []
    for batch in (1, 100):
        result = measure(300 if quick else 3000, batch)
        over = result["robot_us"] - result["raw_us"]
        print(f"read_{batch}: {over:.2f} us over the raw read ({json.dumps(result)})")
        if over > MOST_US:
            failures.append(f"read_{batch} costs {over:.2f} us over the raw read, more than {MOST_US:g}")
    result = keep_up(1.0 if quick else 5.0)
    print(f"keep_up: {json.dumps(result)}")
    if result["messages"] != int(RATE * (1.0 if quick else 5.0)) or result["late_s"] > 0.5:
        failures.append(f"{RATE} messages/s fall behind: {result}")
    if failures and not quick:
        sys.exit("\n".join(failures))


if __name__ == "__main__":
    main()
