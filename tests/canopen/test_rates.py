# SPDX-License-Identifier: Apache-2.0
"""How fast objects go over the kernel's CAN: regista-can and its device, and in turn python-canopen and its drive.

With REGISTA_CAN=vcan0 under tests/vm/with-vcan; skipped elsewhere. A vcan takes no time for a frame: what is compared
is what both ends and the kernel need. What the bus itself leaves is in sdo_test.cpp, on the bus in memory.
"""

import contextlib
import os
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("can")
canopen = pytest.importorskip("canopen")

ROOT = Path(__file__).resolve().parents[2]
PEER = ROOT / "tests/canopen/peer"
EDS = ROOT / "tests/data/canopen/drive.eds"
PROGRAM = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-can"
KERNEL = os.environ.get("REGISTA_CAN")
LIMIT = 60  # [s], of anything that a test waits for
PATIENCE = 20.0  # [s], with an answer: the guest's processor is one of a busy machine
ROUNDS = 3

pytestmark = pytest.mark.skipif(not KERNEL, reason="needs REGISTA_CAN and a kernel with CAN (tests/vm/with-vcan)")


@contextlib.contextmanager
def serving(*command):
    """Only while it is measured: on one processor, who only listens makes others slow."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.wait()


def ours(folder, size):
    """[bytes/s] down and up."""
    file = folder / "data"
    file.write_bytes(os.urandom(size))
    tool = [PROGRAM, "-b", KERNEL, "--timeout", str(PATIENCE)]
    rates = []
    with serving(*tool, "device", "9", EDS):
        for verb in "write", "read":
            command = [*tool, verb, "9", "2001", "--block", "--rate", "--file", file]
            done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
            assert done.returncode == 0, done.stderr
            rates.append(float(re.search(r"(\d+) bytes/s", done.stderr)[1]))
    return rates


def theirs(size):
    drive = [sys.executable, PEER / "drive.py", "--interface", "socketcan", "--channel", KERNEL, "--node", "5"]
    network = canopen.Network()
    network.connect(interface="socketcan", channel=KERNEL)
    node = network.add_node(5, str(EDS))
    node.sdo.RESPONSE_TIMEOUT = PATIENCE
    try:
        with serving(*drive):
            begun = time.perf_counter()
            with node.sdo.open(0x2001, 0, "wb", size=size, block_transfer=True) as stream:
                stream.write(os.urandom(size))
            down = size / (time.perf_counter() - begun)
            begun = time.perf_counter()
            with node.sdo.open(0x2001, 0, "rb", block_transfer=True) as stream:
                assert len(stream.read()) == size
            return [down, size / (time.perf_counter() - begun)]
    finally:
        network.disconnect()


def test_blocks_go_faster_than_with_python_canopen(tmp_path):
    """Nine times, or three when the guest's scheduler hands over at its ticks of 10 ms, twice a block."""
    rounds = [(theirs(5_000), ours(tmp_path, 50_000)) for _ in range(ROUNDS)]
    for direction, way in enumerate(("down", "up")):
        slow = statistics.median(python[direction] for python, _ in rounds)
        fast = statistics.median(regista[direction] for _, regista in rounds)
        print(f"block {way}: {fast:.0f} bytes/s, python-canopen {slow:.0f} bytes/s: {fast / slow:.1f} times")
        assert fast > slow
