# SPDX-License-Identifier: Apache-2.0
"""A server in a process of its own, and a client of packed bytes: for faults that need a process to die or stop."""

import contextlib
import os
import socket
import struct
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")).resolve()
PLUGINS = BIN.parent / "lib/regista-faults"
SERVER = BIN / "regista-server"

DATA, COMMAND, REQUEST, ACK, SYNCH, NACK = range(1, 7)
POSITION2D = 4
NOISE = 0.3  # s that a loaded machine may add to what the table asks


class Client:
    """One connection to a server; what it sends is packed here, without the server's codec."""

    def __init__(self, port, timeout=10):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.banner = self.exactly(32)

    def exactly(self, size):
        data = b""
        while len(data) < size:
            more = self.socket.recv(size - len(data))
            if not more:
                raise ConnectionError("the server closed the connection")
            data += more
        return data

    def send(self, interface, index, kind, subtype, body=b""):
        self.socket.sendall(struct.pack(">6IdII", 0, 0, interface, index, kind, subtype, 0, 0, len(body)) + body)

    def receive(self):
        """(interface, index, type, subtype, stamp, body)"""
        header = struct.unpack(">6IdII", self.exactly(40))
        return *header[2:7], self.exactly(header[8])

    def ask(self, interface, index, subtype, body=b""):
        self.send(interface, index, REQUEST, subtype, body)
        while True:
            message = self.receive()
            if message[2] in (ACK, NACK):
                return message

    def open(self, index=0):
        reply = self.ask(1, 0, 3, struct.pack(">7I", 0, 0, POSITION2D, index, 1, 0, 0))
        assert reply[2] == ACK, reply

    def pull(self):
        assert self.ask(1, 0, 5, struct.pack(">I", 2))[2] == ACK

    def velocity(self, x, index=0):
        self.send(POSITION2D, index, COMMAND, 1, struct.pack(">3dI", x, 0, 0, 1))

    def identify(self, name, priority=10):
        text = name.encode() + b"\0"
        body = struct.pack(">II", len(text), len(text)) + text + bytes(-len(text) % 4) + struct.pack(">i", priority)
        assert self.ask(1, 0, 101, body)[2] == ACK

    def close(self):
        self.socket.close()


class ServerProcess:
    """regista-server with a configuration, on a port of its own."""

    def __init__(self, folder, config, plugins, arguments=(), options=(), **popen):
        self.config = folder / "robot.cfg"
        self.config.write_text(config)
        self.log_file = folder / "log"
        self.log_stream = self.log_file.open("w")
        address = ["--port", "0", "--listen", "127.0.0.1"]
        command = [*arguments, SERVER, *address, "--plugins", plugins, *options, self.config]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log_stream, text=True, **popen)
        ready = self.process.stdout.readline()
        assert ready.startswith("regista-server: ready on "), ready + self.log()
        self.port = int(ready.rsplit(":", 1)[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.log_stream.close()

    def log(self):
        return self.log_file.read_text()


class Server(ServerProcess):
    """A fake_base for position2d:0 behind regista-server; what happens to the base stands in a file."""

    def __init__(self, folder, keys="", more="", **process):
        self.record = folder / "record"
        base = f'driver ( name "fake_base" provides ["position2d:0"] rate 100 log "{self.record}" {keys} )'
        super().__init__(folder, f"{more}\n{base}\n", PLUGINS, **process)

    def events(self, *names, since=0.0):
        """[(monotonic time in s, name, numbers)]"""
        found = []
        for line in self.record.read_text().splitlines():
            stamp, name, *numbers = line.split()
            if name in names and int(stamp) * 1e-9 >= since:
                found.append((int(stamp) * 1e-9, name, [float(n) for n in numbers]))
        return found

    def driven(self, x, since=0.0):
        return wait_for(lambda: [e for e in self.events("velocity", since=since) if e[2][0] == x])[0][0]

    def rested(self, since):
        def rests():
            return [e for e in self.events("velocity", "halt", since=since) if e[1] == "halt" or not any(e[2])]

        return wait_for(rests)[0][0]

    def rss(self):
        """Resident memory [bytes]."""
        statm = Path(f"/proc/{self.process.pid}/statm").read_text()
        return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def cpu(self):
        """Processor time so far [s]."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def descriptors(self):
        return len(list(Path(f"/proc/{self.process.pid}/fd").iterdir()))


def wait_for(look, timeout=10.0):
    """What `look` returns, once that is true."""
    end = time.monotonic() + timeout
    while not (found := look()):
        if time.monotonic() > end:
            raise TimeoutError("it did not happen")
        time.sleep(0.002)
    return found


def quantiles(name, durations):
    ordered = sorted(durations)
    p50, p99 = ordered[len(ordered) // 2], ordered[min(int(len(ordered) * 0.99), len(ordered) - 1)]
    print(f"{name}: p50 {1e3 * p50:.2f} ms, p99 {1e3 * p99:.2f} ms of {len(ordered)}")
    return p50, p99


@contextlib.contextmanager
def closing(clients):
    try:
        yield clients
    finally:
        for client in clients:
            client.close()
