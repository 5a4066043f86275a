# SPDX-License-Identifier: Apache-2.0
"""Real servers and scripted ones, for the tests of the installed package."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted import ScriptedServer

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")).resolve()

CONFIG = """
driver ( name "simulated_base" provides ["position2d:0"] rate 200 noise 0.01 lease 1 )
driver ( name "simulated_battery" provides ["power:0"] requires ["position2d:0"] rate 100 )
driver ( name "simulated_kicker" provides ["kicker:0"] rate 100 charge_time 0.1 )
driver ( name "lamps" provides ["opaque:0"] rate 100 )
driver ( name "turntable" provides ["position1d:0"] rate 100 )
"""


class Server:
    """A regista-server in a process of its own, on a free port."""

    def __init__(self, config: Path, *arguments: str) -> None:
        plugins = BIN.parent / "lib/regista-examples"
        command = [BIN / "regista-server", "--log-level", "error", "--plugins", plugins, *arguments, config]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        ready = self.process.stdout.readline()
        assert "ready on" in ready, ready
        self.port = int(ready.rsplit(":", 1)[1])

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[], Server]]:
    """Start a server that is the test's own: to kill, to stop."""
    config = tmp_path / "robot.cfg"
    config.write_text(CONFIG)
    servers: list[Server] = []

    def start_one() -> Server:
        servers.append(Server(config, "--port", "0"))
        return servers[-1]

    yield start_one
    for server in servers:
        server.end()


@pytest.fixture(scope="session")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of a server that all tests share."""
    config = tmp_path_factory.mktemp("server") / "robot.cfg"
    config.write_text(CONFIG)
    server = Server(config, "--port", "0")
    yield server.port
    server.end()


@pytest.fixture
def scripted() -> Iterator[Callable[..., ScriptedServer]]:
    servers: list[ScriptedServer] = []

    def start_one(*arguments: object) -> ScriptedServer:
        servers.append(ScriptedServer(*arguments))  # type: ignore[arg-type]
        return servers[-1]

    yield start_one
    for server in servers:
        server.close()
