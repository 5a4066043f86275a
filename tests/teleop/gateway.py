# SPDX-License-Identifier: Apache-2.0
"""`regista teleop` under test."""

import contextlib
import signal
import subprocess
import threading

import regista
from command_line import REGISTA, ROOT, Server, environment


class Gateway:
    """`regista teleop` in a process of its own."""

    def __init__(self, *robots, folder, options=()):
        self.process = subprocess.Popen(
            [*REGISTA, "teleop", "--no-browser", "--recordings", folder, *options, *robots],
            stdout=subprocess.PIPE,
            text=True,
            env=environment(),
        )
        self.url = self.process.stdout.readline().strip()
        assert self.url.startswith("http://127.0.0.1:"), self.url

    def kill(self, number=signal.SIGKILL):
        self.process.send_signal(number)
        self.process.wait()

    def end(self):
        if self.process.poll() is None:
            self.kill(signal.SIGTERM)
        self.process.stdout.close()


@contextlib.contextmanager
def serving(example, folder):
    """A robot of examples/, and its gateway."""
    with Server(ROOT / "examples" / example) as server:
        gateway = Gateway(server.robot, folder=folder)
        yield server, gateway
        gateway.end()


@contextlib.contextmanager
def program(server, drive):
    """Another program than the page: `drive(robot, ended)`, on a thread of its own, until `ended()`."""
    end = threading.Event()

    def run():
        with regista.Robot("127.0.0.1", server.port, name="nav@laptop") as robot:
            drive(robot, end.is_set)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
