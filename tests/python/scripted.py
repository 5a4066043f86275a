# SPDX-License-Identifier: Apache-2.0
"""A server on a real socket that does what a test says. Its codec is its own, so that a wrong byte of ours is seen."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Callable
from typing import NamedTuple

DATA, COMMAND, REQUEST, ACK, SYNCH, NACK = range(1, 7)
BANNER = b"Player v.3.1.1-dev".ljust(32, b"\0")


class Message(NamedTuple):
    interface: int
    index: int
    kind: int
    subtype: int
    sequence: int
    body: bytes


def pack(
    interface: int, index: int, kind: int, subtype: int, body: bytes = b"", stamp: float = 0, seq: int = 0
) -> bytes:
    return struct.pack(">6IdII", 0x0100007F, 6665, interface, index, kind, subtype, stamp, seq, len(body)) + body


def state(x: float, stamp: float = 0) -> bytes:
    """position2d:0 is at x."""
    return pack(4, 0, DATA, 1, struct.pack(">6dI", x, 0, 0, 0, 0, 0, 0), stamp)


class Peer:
    """The server's end of one connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            more = self.socket.recv(size - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def next(self) -> Message:
        """What the client says; EOFError when it is gone."""
        _, _, interface, index, kind, subtype, _, sequence, size = struct.unpack(">6IdII", self.exactly(40))
        return Message(interface, index, kind, subtype, sequence, self.exactly(size))

    def answer(self, message: Message, kind: int, body: bytes = b"") -> None:
        self.socket.sendall(pack(message.interface, message.index, kind, message.subtype, body, seq=message.sequence))

    def serve(self, message: Message) -> None:
        """As a stock server that has every device answers."""
        if message.kind != REQUEST:
            return
        if message.interface == 1 and message.subtype == 3:
            driver = b"scripted\0"
            text = struct.pack(">II", len(driver), len(driver)) + driver.ljust(12, b"\0")
            self.answer(message, ACK, message.body[:20] + text)
        else:
            self.answer(message, NACK if message.interface == 1 and message.subtype >= 100 else ACK)


class ScriptedServer:
    """Greets whoever connects, and runs the script with each."""

    def __init__(self, script: Callable[[Peer], None], banner: bytes = BANNER) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self.listener.getsockname()[1])
        self.script, self.banner = script, banner
        self.peers: list[Peer] = []
        self.thread = threading.Thread(target=self._accept, daemon=True)
        self.thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self.listener.accept()
                self.peers.append(Peer(connection))
                threading.Thread(target=self._run, args=(self.peers[-1],), daemon=True).start()

    def _run(self, peer: Peer) -> None:
        with contextlib.suppress(OSError, EOFError), peer.socket:
            peer.socket.sendall(self.banner)
            self.script(peer)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        for peer in self.peers:
            with contextlib.suppress(OSError):
                peer.socket.shutdown(socket.SHUT_RDWR)


def obliging(peer: Peer) -> None:
    """Serves until the client is gone."""
    while True:
        peer.serve(peer.next())
