# SPDX-License-Identifier: Apache-2.0
"""A real server, and the command `regista` in a process of its own."""

import contextlib
import io
import json
import os
import pty
import select
import subprocess
import sys
import threading
import time
from pathlib import Path

import regista
from mcap.stream_reader import StreamReader

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests/python"))  # scripted.py
BIN = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")).resolve()
SERVER = BIN / "regista-server"
REGISTA = [sys.executable, "-m", "regista.cli"]
PATIENCE = 60  # s: a loaded machine is slow, not wrong


def environment(**more):
    kept = {k: v for k, v in os.environ.items() if k not in ("REGISTA_ROBOT", "NO_COLOR", "FORCE_COLOR")}
    return {**kept, "REGISTA_SERVER": str(SERVER), "COLUMNS": "120", **more}


class Server:
    """regista-server with a configuration, on a port of its own unless it is named."""

    def __init__(self, config, port=0, listen="127.0.0.1", options=()):
        command = [SERVER, "--port", str(port), "--listen", listen, "--log-level", "off", *options, config]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        ready = self.process.stdout.readline()
        assert ready.startswith("regista-server: ready on "), ready
        self.port = int(ready.rsplit(":", 1)[1])
        self.robot = f"[{listen}]:{self.port}" if ":" in listen else f"{listen}:{self.port}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def run(self, verb, *arguments, **options):
        """The verb against this server."""
        return run(verb, *arguments, "--robot", self.robot, **options)

    def json(self, verb, *arguments):
        """What the verb says with --json."""
        done = self.run(verb, *arguments, "--json")
        assert done.returncode == 0, done
        return json.loads(done.stdout)

    def start(self, verb, *arguments, **options):
        return subprocess.Popen(
            [*REGISTA, verb, *map(str, arguments), "--robot", self.robot], env=environment(), text=True, **options
        )


def run(*arguments, env=None, **options):
    command = [*REGISTA, *map(str, arguments)]
    options = {"capture_output": True, "text": True, "timeout": PATIENCE, "check": False, **options}
    return subprocess.run(command, env=environment(**(env or {})), **options)


def wait_for(look, timeout=PATIENCE):
    """What `look` returns, once that is true."""
    end = time.monotonic() + timeout
    while not (found := look()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)
    return found


class Terminal:
    """A verb on a pseudo-terminal: what it shows, and keys for it."""

    def __init__(self, *arguments, **env):
        self.master, slave = pty.openpty()
        command = [*REGISTA, *map(str, arguments)]
        self.process = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=environment(TERM="xterm", **env),
            start_new_session=True,
        )
        os.close(slave)
        self.shown = ""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        with contextlib.suppress(OSError):
            os.close(self.master)

    def keys(self, text):
        os.write(self.master, text.encode())

    def look(self, timeout=0.0):
        """All that it has shown so far."""
        while select.select([self.master], [], [], timeout)[0]:
            try:
                data = os.read(self.master, 65536)
            except OSError:  # it has ended
                break
            if not data:
                break
            self.shown += data.decode("utf-8", "replace")
        return self.shown

    def wait_for(self, text):
        return wait_for(lambda: text in self.look(0.02))

    def end(self):
        """Its exit code."""
        wait_for(lambda: self.look(0.02) is not None and self.process.poll() is not None)
        self.look()
        return self.process.returncode


@contextlib.contextmanager
def owned(server, name, priority):
    """Somebody else drives: who is idle for the lease owns no more."""
    stop, ready = threading.Event(), threading.Event()

    def drive():
        with regista.Robot("127.0.0.1", server.port, name=name, priority=priority) as robot:
            robot.position2d().take()
            while not stop.is_set():
                robot.position2d().set_velocity(w=0.2)
                robot.read(timeout=0.02)
                ready.set()

    thread = threading.Thread(target=drive)
    thread.start()
    ready.wait()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def by_pypi(data):
    """The messages that PyPI's own reader finds before it meets the end."""
    found = []
    try:
        for record in StreamReader(io.BytesIO(data), validate_crcs=True).records:
            if type(record).__name__ == "Message":
                found.append(record)
    except Exception as error:
        assert type(error).__module__.partition(".")[0] in ("mcap", "struct", "zstandard", "backports"), repr(error)
    return found
