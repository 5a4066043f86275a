# SPDX-License-Identifier: Apache-2.0
"""Two controllers on one bus, with REGISTA_CONTROLLERS="can0 can1" under `tests/vm/with-vcan -k`; skipped elsewhere.

QEMU's SJA1000 has bit timing and states, but no errors: neither a missing acknowledgement nor another bit rate disturbs
a frame, so it never goes bus-off; that is in master_test.cpp and test_can_motor.py. Its frames take no time, so a burst
overruns its receive buffer of 64 bytes: no block transfers here.
"""

import contextlib
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "tests/data/canopen/drive.eds"
PROGRAM = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-can"
NAMES = os.environ.get("REGISTA_CONTROLLERS", "").split()
LIMIT = 60  # [s], of anything that a test waits for

pytestmark = pytest.mark.skipif(len(NAMES) != 2, reason="needs REGISTA_CONTROLLERS (tests/vm/with-vcan -k)")


def link(*arguments):
    return subprocess.run(["ip", "link", "set", *arguments], capture_output=True, text=True)


def tool(*arguments):
    command = [PROGRAM, "-b", NAMES[0], "--timeout", "10", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)


@contextlib.contextmanager
def device():
    command = [PROGRAM, "-b", NAMES[1], "--timeout", "10", "device", "9", EDS]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("bit_rate", [125_000, 1_000_000])
def test_data_go_both_ways_at_any_bit_rate(bit_rate, tmp_path):
    for name in NAMES:
        assert link(name, "down").returncode == 0
        assert link(name, "up", "type", "can", "bitrate", str(bit_rate)).returncode == 0
        details = subprocess.run(["ip", "-details", "link", "show", name], capture_output=True, text=True)
        assert f"bitrate {bit_rate} " in details.stdout
    sent, back = tmp_path / "sent", tmp_path / "back"
    sent.write_bytes(os.urandom(500))
    with device():
        assert tool("write", "9", "2001", "--file", sent).stderr == ""
        assert tool("read", "9", "2001", "--file", back).stderr == ""
    assert back.read_bytes() == sent.read_bytes()


def test_an_interface_that_goes_down_and_up_again():
    with device() as before:
        assert tool("read", "9", "1000", "--type", "unsigned32").stdout == "131474\n"
        assert link(NAMES[1], "down").returncode == 0
        assert before.wait(LIMIT) == 1
        assert "Network is down" in before.stderr.read()
    assert link(NAMES[1], "up").returncode == 0
    with device():
        assert link(NAMES[0], "down").returncode == 0
        assert "Network is down" in tool("read", "9", "1000").stderr
        assert link(NAMES[0], "up").returncode == 0
        assert tool("read", "9", "1000", "--type", "unsigned32").stdout == "131474\n"


def test_a_restart_is_for_controllers_that_are_bus_off():
    assert link(NAMES[0], "type", "can", "restart").returncode != 0
    with device():
        assert tool("read", "9", "1000", "--type", "unsigned32").stdout == "131474\n"
