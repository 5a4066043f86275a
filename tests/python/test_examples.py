# SPDX-License-Identifier: Apache-2.0
"""The numbered examples: each in Python and in C++, and both print the same."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import BIN, Server

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CONFIGS = {"06_two_robots": "two_robots.cfg", "08_opaque": "opaque.cfg", "11_mission": "field.cfg"}
NAMES = sorted(path.stem for path in EXAMPLES.glob("[0-9]*.py"))
ON_A_FIELD = ["09_team", "10_destinations"]


def wait_for_the_usual_port():
    """Another run of the tests on this machine may have it for a moment."""
    end = time.monotonic() + 60
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", 6665)) != 0 or time.monotonic() > end:
                return
        time.sleep(0.2)


def test_each_has_its_twin_and_thirty_lines():
    assert sorted(path.stem for path in EXAMPLES.glob("[0-9]*.cpp")) == NAMES
    for path in EXAMPLES.glob("[0-9]*.*"):
        assert len(path.read_text().splitlines()) <= 30, path


@pytest.mark.parametrize("name", sorted(set(NAMES) - set(ON_A_FIELD)))
def test_prints_what_its_twin_prints(name):
    if name == "11_mission" and not (BIN.parent / "lib/regista/simulated_gps.so").exists():
        pytest.skip("built without libgps and GeographicLib")
    wait_for_the_usual_port()
    server = Server(EXAMPLES / CONFIGS.get(name, "sim.cfg"))
    try:
        program = [sys.executable, EXAMPLES / f"{name}.py"]
        result = subprocess.run(program, capture_output=True, text=True, timeout=60, check=False)
    finally:
        server.end()
    assert result.stderr == ""
    assert result.stdout == (EXAMPLES / f"expected/{name}.txt").read_text()


@pytest.mark.parametrize("name", ON_A_FIELD)
@pytest.mark.skipif(not (BIN / "regista-field-sim").exists(), reason="built without REGISTA_VISION")
def test_prints_on_a_field_what_its_twin_prints(name):
    ports = 20000 + 64 * (os.getpid() % 150)
    field = [
        EXAMPLES / "soccer/field.sh",
        "--yellow",
        "3",
        "--blue",
        "0",
        "--port",
        str(ports),
        "--udp",
        str(ports + 40),
    ]
    program = [sys.executable, EXAMPLES / f"{name}.py"]
    environment = {**os.environ, "REGISTA_BIN": str(BIN)}
    result = subprocess.run(
        [*field, "--", *program], capture_output=True, text=True, timeout=60, check=False, env=environment
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout == (EXAMPLES / f"expected/{name}.txt").read_text()


def test_the_server_is_where_it_is_looked_for():
    assert (BIN / "regista-server").exists()
