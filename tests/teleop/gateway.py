# SPDX-License-Identifier: Apache-2.0
"""`regista teleop` under test."""

import signal
import subprocess

from command_line import REGISTA, environment


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
