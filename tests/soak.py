#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Lets clients come and go while others stay, and sees that the server's memory and descriptors stay flat.

python3 tests/soak.py --seconds 600                            # churn
python3 tests/soak.py --seconds 3600 --visits-per-second 0     # an hour of five clients, 50 Hz, and commands at 20 Hz

Fails when, from a tenth of the time on, the resident memory grows by more than 1 MiB, when at the end, the passing
clients gone, a descriptor more is open than before they came, or when a command of those that stay was lost. Prints how
old the data was on arrival.
"""

import argparse
import json
import os
import pathlib
import selectors
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

HEADER = struct.Struct(">IIIIIIdII")  # host, robot, interface, index, kind, subtype, timestamp, sequence, size
DATA, COMMAND, REQUEST, ACK, NACK = 1, 2, 3, 4, 6
PLAYER, POSITION2D = 1, 4
OPEN = 1
CONFIG = """
driver (name "simulated_base" provides ["position2d:0"] rate 50)
driver (name "simulated_battery" provides ["power:0"] requires ["position2d:0"] rate 1)
"""


class Client:
    """A raw client: it does not use our codec."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.stream = self.socket.makefile("rb")
        if not self.stream.read(32).startswith(b"Player v."):
            raise ConnectionError("no banner")

    def send(self, kind, interface, subtype, body=b""):
        self.socket.sendall(HEADER.pack(0, 0, interface, 0, kind, subtype, 0.0, 0, len(body)) + body)

    def receive(self):
        header = HEADER.unpack(self.stream.read(HEADER.size))
        self.stream.read(header[8])
        return header[4], header[2]

    def request(self, interface, subtype, body=b""):
        self.send(REQUEST, interface, subtype, body)
        while True:
            kind, about = self.receive()
            if kind in (ACK, NACK) and about == interface:
                return kind == ACK

    def subscribe(self, interface):
        if not self.request(PLAYER, 3, struct.pack(">7I", 0, 0, interface, 0, OPEN, 0, 0)):
            raise ConnectionError("refused")

    def drive(self, speed):
        self.send(COMMAND, POSITION2D, 1, struct.pack(">dddI", speed, 0.0, 0.1, 1))

    def close(self):
        self.stream.close()
        self.socket.close()


class Server:
    def __init__(self, build):
        with tempfile.NamedTemporaryFile("w", suffix=".cfg") as config:
            config.write(CONFIG)
            config.flush()
            command = [build / "bin/regista-server", "--port", "0", "--log-level", "off", config.name]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            self.port = int(self.process.stdout.readline().rsplit(":", 1)[1])
        self.proc = pathlib.Path("/proc") / str(self.process.pid)

    def resident_kib(self):
        return int((self.proc / "statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") // 1024

    def descriptors(self):
        return len(list((self.proc / "fd").iterdir()))

    def commands(self):
        """How many came to its base, how many were refused, and how many replaced by newer ones or dropped."""
        command = [self.process.args[0], "--status", f"localhost:{self.port}"]
        base = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)["drivers"][0]
        lost = base["commands_replaced"] + base["devices"][0]["commands_dropped"]
        return base["commands"], base["commands_refused"], lost

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=10)


class Seen:
    """What those that stay have seen."""

    def __init__(self):
        self.commands, self.messages = 0, 0
        self.ages = [0] * 100_000  # how many messages were so many times 10 us old

    def take(self, buffer):
        """Counts the messages in the buffer and removes them from it."""
        now, at = time.time(), 0
        while len(buffer) - at >= HEADER.size:
            header = HEADER.unpack_from(buffer, at)
            if len(buffer) - at < HEADER.size + header[8]:
                break
            at += HEADER.size + header[8]
            if header[4] == DATA:
                self.messages += 1
                self.ages[min(max(int((now - header[6]) * 1e5), 0), len(self.ages) - 1)] += 1
        del buffer[:at]

    def age_ms(self, quantile):
        rank, below = quantile * self.messages, 0
        for age, count in enumerate(self.ages):
            below += count
            if below >= rank:
                return age / 100
        return 0.0


def stay(port, done, seen):
    """Five clients that read all the time; the first also drives, at 20 Hz."""
    clients = [Client(port) for _ in range(5)]
    selector = selectors.DefaultSelector()
    for client in clients:
        client.subscribe(POSITION2D)
        selector.register(client.socket, selectors.EVENT_READ, bytearray())
    next_command = time.monotonic()
    while not done.is_set():
        if time.monotonic() >= next_command:
            next_command += 0.05
            clients[0].drive(0.2)
            seen.commands += 1
        for key, _ in selector.select(max(0.0, next_command - time.monotonic())):
            received = key.fileobj.recv(1 << 16)
            if not received:
                raise ConnectionError("a client that stays was disconnected")
            key.data.extend(received)
            seen.take(key.data)
    clients[0].request(POSITION2D, 1)  # the server has taken what was sent before this
    for client in clients:
        client.close()


def visit(port, number):
    """Comes, subscribes, asks, commands, and leaves, every third time without a word of goodbye."""
    client = Client(port)
    client.subscribe(POSITION2D)
    client.request(POSITION2D, 1)
    client.drive(0.1)
    if number % 3 == 0:  # reset
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def settle(server, descriptors):
    """Waits until the server has noticed who left."""
    end = time.monotonic() + 5
    while server.descriptors() > descriptors and time.monotonic() < end:
        time.sleep(0.05)
    return server.descriptors()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, default="build/release", help="folder with bin/ and lib/regista/")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--visits-per-second", type=float, default=100)
    options = parser.parse_args()

    server = Server(options.build)
    done, seen = threading.Event(), Seen()
    failures = []

    def stayers():
        try:
            stay(server.port, done, seen)
        except Exception as error:  # told by the main thread
            failures.append(error)

    thread = threading.Thread(target=stayers)
    thread.start()
    time.sleep(1)  # until those that stay are there
    descriptors_before = server.descriptors()

    begin = time.monotonic()
    visits, next_line, baseline_kib = 0, 0.0, None
    while (elapsed := time.monotonic() - begin) < options.seconds and not failures:
        if baseline_kib is None and elapsed > options.seconds / 10:
            baseline_kib = server.resident_kib()
        if elapsed >= next_line:
            next_line += options.seconds / 10
            print(
                f"{elapsed:6.0f} s  {visits:7} visits  {seen.messages:8} messages, age p99 {seen.age_ms(0.99):.2f} ms  "
                f"RSS {server.resident_kib()} KiB  {server.descriptors()} descriptors",
                flush=True,
            )
        if options.visits_per_second == 0:
            time.sleep(options.seconds / 1000)
            continue
        visit(server.port, visits)
        visits += 1
        time.sleep(max(0.0, begin + visits / options.visits_per_second - time.monotonic()))

    descriptors = settle(server, descriptors_before)
    growth_kib = server.resident_kib() - baseline_kib
    done.set()
    thread.join()
    commands, refused, lost = server.commands()
    lost += max(0, seen.commands + visits - commands)
    lost += max(0, refused - visits)  # a visitor's may be: the base belongs to the first of those that stay
    status = server.stop()
    print(
        f"{visits} visits, {commands} commands, {lost} lost: RSS {baseline_kib} KiB {growth_kib:+} KiB; "
        f"descriptors {descriptors_before} before, {descriptors} after; exit status {status}; age of "
        f"{seen.messages} messages p50 {seen.age_ms(0.5):.2f} ms, p99 {seen.age_ms(0.99):.2f} ms"
    )
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures or growth_kib > 1024 or descriptors > descriptors_before or lost > 0 or status != 0 else 0


if __name__ == "__main__":
    sys.exit(main())
