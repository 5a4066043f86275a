# SPDX-License-Identifier: Apache-2.0
"""What only the kernel's CAN can show. With REGISTA_CAN=vcan0 under tests/vm/with-vcan; skipped elsewhere."""

import os
import subprocess
import time
from pathlib import Path

import pytest

can = pytest.importorskip("can")
canopen = pytest.importorskip("canopen")

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "tests/data/canopen/drive.eds"
PROGRAM = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-can"
KERNEL = os.environ.get("REGISTA_CAN")
LIMIT = 60  # [s], of anything that a test waits for
TOOL = [PROGRAM, "-b", KERNEL, "--timeout", "10"]  # an emulated kernel has one processor of a busy machine

pytestmark = pytest.mark.skipif(not KERNEL, reason="needs REGISTA_CAN and a kernel with CAN (tests/vm/with-vcan)")


class Running:
    """regista-can, whose lines are read one after the other."""

    def __init__(self, *arguments):
        self.command = [*TOOL, *map(str, arguments)]

    def __enter__(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(LIMIT)

    def line_with(self, wanted):
        for line in self.process.stdout:
            if wanted in line:
                return line
        raise AssertionError(f"it ended before it said '{wanted}': {self.process.stderr.read()}")


def cansend(frame):
    subprocess.run(["cansend", KERNEL, frame], check=True)


def listeners():
    """Sockets that take every frame of the bus."""
    return Path("/proc/net/can/rcvlist_all").read_text().count(f" {KERNEL} ")


def link(*arguments):
    subprocess.run(["ip", "link", "set", KERNEL, *arguments], check=True)


@pytest.fixture
def dump():
    with Running("dump", "--words") as running:
        assert "listening" in running.process.stderr.readline()
        yield running


def test_error_frames_are_told(dump):
    cansend("20000040#0000000000000000")
    assert dump.line_with("20000040#").endswith("controller: bus-off\n")
    cansend("20000004#0020000000000000")
    assert dump.line_with("20000004#").endswith("controller: error passive\n")
    cansend("20000020#0000000000000000")
    assert dump.line_with("20000020#").endswith("controller: not acknowledged\n")


def test_can_utils_and_we_write_the_same_log(dump):
    listening = listeners()
    with subprocess.Popen(["candump", "-L", "-n", "4", KERNEL], stdout=subprocess.PIPE, text=True) as theirs:
        deadline = time.monotonic() + LIMIT
        while listeners() == listening:  # it does not say when it listens
            assert time.monotonic() < deadline
            time.sleep(0.01)
        for frame in "123#", "605#4041600000000000", "1F334455#1122", "705#R1":
            cansend(frame)
        logged = [line.split()[1:3] for line in theirs.stdout]
    assert [frame for _, frame in logged] == ["123#", "605#4041600000000000", "1F334455#1122", "705#R1"]
    for interface, frame in logged:
        assert f" {interface} {frame}  " in dump.line_with(frame)


def test_an_interface_that_goes_down_is_an_error_in_words():
    with Running("device", 9, EDS) as device:
        device.line_with("ready")
        link("down")
        try:
            assert device.process.wait(LIMIT) == 1
            assert "Network is down" in device.process.stderr.read()
        finally:
            link("up")


def test_our_device_answers_remote_frames():
    with Running("device", 9, EDS) as device, can.Bus(interface="socketcan", channel=KERNEL) as bus:
        device.line_with("ready")
        bus.set_filters([{"can_id": 0x709, "can_mask": 0x7FF}])
        states = []
        for _ in range(3):
            bus.send(can.Message(arbitration_id=0x709, is_extended_id=False, is_remote_frame=True, dlc=1))
            answer = bus.recv(LIMIT)
            while answer.is_remote_frame or answer.data[0] == 0:
                answer = bus.recv(LIMIT)
            states.append(answer.data[0])
        assert states == [0x7F, 0xFF, 0x7F]


def test_a_block_transfer_survives_a_queue_that_is_full(tmp_path):
    """CANopenNode#242: ENOBUFS in the middle of a block. A token bucket makes the interface as slow as 1 Mbit/s."""
    shaped = ["tc", "qdisc", "replace", "dev", KERNEL, "root", "tbf", "rate", "1024kbit", "burst", "80", "limit", "160"]
    if subprocess.run(shaped, stderr=subprocess.DEVNULL).returncode:
        link("txqueuelen", "10")  # this kernel has no token bucket: the queue at least is short
    data = tmp_path / "data"
    data.write_bytes(os.urandom(5000))
    back = tmp_path / "back"
    with Running("device", 9, EDS) as device:
        device.line_with("ready")
        for command in (
            ["write", "9", "2001", "--block", "--file", data],
            ["read", "9", "2001", "--block", "--file", back],
        ):
            done = subprocess.run([*TOOL, *command], capture_output=True, text=True, timeout=LIMIT)
            assert done.returncode == 0, done.stderr
    assert back.read_bytes() == data.read_bytes()
    subprocess.run(["tc", "qdisc", "del", "dev", KERNEL, "root"], stderr=subprocess.DEVNULL)
