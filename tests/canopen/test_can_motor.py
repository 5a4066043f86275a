# SPDX-License-Identifier: Apache-2.0
"""regista-server, its driver can_motor, and drives on python-canopen in processes of their own: what dies, dies really.

Over a bus in user space, or with REGISTA_CAN=vcan0 over the kernel's (tests/vm/with-vcan).
"""

import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("can")
pytest.importorskip("canopen")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/faults"))
from regista_process import BIN, DATA, NACK, NOISE, POSITION2D, Client, ServerProcess, wait_for  # noqa: E402

PEER = ROOT / "tests/canopen/peer"
KERNEL = os.environ.get("REGISTA_CAN")
PLUGINS = BIN.parent / "lib/regista"
LEFT, RIGHT = 5, 6
LIMIT = 30  # [s], of anything that a test waits for

CONFIG = """
driver
(
  name "can_motor" provides ["actarray:0" "power:0"] alwayson true
  bus "{bus}" nodes [5 6] gear 20 wheel_speed 1200 wheel_accel 2000 wheel_decel 2000 quick_stop 2000 {rate}
)
driver
(
  name "differential" provides ["position2d:0"] requires ["actarray:0"] wheel_radius 0.1 track 0.4 accel 10
)
"""
# An emulated kernel has one slow processor for all.
SLACK = 1.0 if KERNEL else NOISE  # [s]
RATE = "rate 20 cycle 0.05 feedback 0.05" if KERNEL else ""


needs_kernel = pytest.mark.skipif(not KERNEL, reason="needs REGISTA_CAN and a kernel with CAN (tests/vm/with-vcan)")
as_well = pytest.mark.skipif(bool(KERNEL), reason="the same over a bus in user space, at full speed")


class Drive:
    """A drive in a process of its own, and what it told: dictionaries with its monotonic time."""

    def __init__(self, node, arguments):
        command = [sys.executable, PEER / "drive.py", *arguments, "--node", str(node)]
        self.node = node
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.told = []
        # A master that is there already may have told it something before it is ready.
        for line in iter(self.process.stdout.readline, "ready\n"):
            assert line, "the drive ended"
            self.told.append(json.loads(line))
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stdout:
            if line.startswith("{"):
                self.told.append(json.loads(line))

    def went(self, state, since=0.0):
        """When it did."""

        def found():
            return [line["time"] for line in self.told if line.get("state") == state and line["time"] >= since]

        return wait_for(found)[0]

    def states(self):
        return [line["state"] for line in self.told if "state" in line]

    def end(self):
        self.process.kill()
        self.process.wait()


class Robot:
    """Two drives, a server and a client that drives."""

    def __init__(self, folder, eds=None):
        self.eds = ["--eds", eds] if eds else []
        self.stack = contextlib.ExitStack()
        if KERNEL:
            self.bus = KERNEL
            self.arguments = ["--interface", "socketcan", "--channel", KERNEL]
        else:
            hub = subprocess.Popen([sys.executable, PEER / "hub.py", "--port", "0"], stdout=subprocess.PIPE, text=True)
            self.stack.callback(hub.wait)
            self.stack.callback(hub.kill)
            port = hub.stdout.readline().split()[0]
            self.bus = f"socketcand://127.0.0.1:{port}/can0"
            self.arguments = ["--interface", "socketcand", "--channel", "can0", "--port", port]
        self.drives = {}
        for node in (LEFT, RIGHT):
            self.start_drive(node)
        self.stack.callback(lambda: [drive.end() for drive in self.drives.values()])
        self.server = self.stack.enter_context(
            ServerProcess(folder, CONFIG.format(bus=self.bus, rate=RATE), PLUGINS, options=["--log-level", "info"])
        )
        self.client = Client(self.server.port)
        self.stack.callback(self.client.close)
        self.client.open()
        self.velocity = 0.0
        self.position = (0.0, 0.0)
        self.silent = False
        threading.Thread(target=self.keep_driving, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.silent = True
        self.stack.close()

    def start_drive(self, node):
        self.drives[node] = Drive(node, [*self.arguments, *self.eds])

    def keep_driving(self):
        with contextlib.suppress(OSError):
            while not self.silent:
                if self.velocity:
                    self.client.velocity(self.velocity)
                time.sleep(0.05)

    def power(self):
        """MOTOR_POWER 1; why it was refused, or nothing."""
        text = struct.pack(">I", 1)
        reply = self.client.ask(POSITION2D, 0, 2, text)
        return reply[2] != NACK

    def up(self):
        for node in self.drives:
            self.logged(f"node {node}: up")
        wait_for(self.power, LIMIT)

    def logged(self, text, since=0):
        try:
            wait_for(lambda: text in self.server.log()[since:], LIMIT)
        except TimeoutError as late:
            raise AssertionError(f"'{text}' is not in the log:\n{self.server.log()}") from late

    def drive(self, velocity=0.5):
        """Until both wheels turn at full speed: 0.5 m/s are 955 rpm."""
        self.velocity = velocity

        def moves():
            message = self.client.receive()
            if message[:4] != (POSITION2D, 0, DATA, 1):
                return False
            return abs(struct.unpack_from(">6d", message[5])[3] - velocity) < 0.01

        wait_for(moves, LIMIT)

    def stopped(self, node, since, within):
        """A drive began its quick stop so soon."""
        drive = self.drives[node]
        began = min(line["time"] for line in wait_for(lambda: left_operation(drive, since)))
        assert began - since <= within + SLACK, f"node {node} stopped {1000 * (began - since):.0f} ms later"
        print(f"node {node} began to stop after {1000 * (began - since):.0f} ms")


def left_operation(drive, since):
    return [
        line
        for line in drive.told
        if line["time"] >= since and line.get("state", "operation enabled") != "operation enabled"
    ]


def eds_without(folder, *indices):
    """The drive without these objects."""
    sections = re.split(r"^(?=\[)", (ROOT / "tests/data/canopen/drive.eds").read_text(), flags=re.MULTILINE)
    missing = tuple(f"[{index}" for index in indices)
    eds = folder / "drive.eds"
    eds.write_text("".join(section for section in sections if not section.startswith(missing)))
    return eds


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        robot.up()
        yield robot


@as_well
def test_it_drives_and_stops(robot):
    robot.drive()
    for drive in robot.drives.values():
        assert drive.states()[-3:] == ["ready to switch on", "switched on", "operation enabled"]
    robot.velocity = 0
    wait_for(lambda: velocity_of(robot) == 0)


def velocity_of(robot):
    while True:
        message = robot.client.receive()
        if message[:4] == (POSITION2D, 0, DATA, 1):
            return struct.unpack_from(">6d", message[5])[3]


def test_f15_drives_stop_by_themselves_when_the_server_is_killed(robot):
    robot.drive()
    killed = time.monotonic()
    robot.server.process.kill()
    for node in robot.drives:
        robot.stopped(node, killed, 0.3)
        assert robot.drives[node].went("quick stop active", killed)


@as_well
def test_f15_a_drive_that_is_pulled_stops_both(robot):
    robot.drive()
    pulled = time.monotonic()
    robot.drives[RIGHT].process.send_signal(signal.SIGSTOP)
    robot.stopped(LEFT, pulled, 0.25 + 0.05)
    robot.logged("node 6: heartbeat lost for 250 ms")
    back = time.monotonic()
    robot.drives[RIGHT].process.send_signal(signal.SIGCONT)
    robot.stopped(RIGHT, back, 0.3)


@as_well
def test_f14_an_emergency_of_one_drive_stops_both_and_power_resets_it(robot):
    robot.drive()
    before = time.monotonic()
    subprocess.run([BIN / "regista-can", "-b", robot.bus, "write", str(LEFT), "2002", "0x3210", "--type", "unsigned16"])
    fault = robot.drives[LEFT].went("fault reaction active", before)
    robot.stopped(RIGHT, fault, 0.05)
    robot.logged("node 5: EMCY 0x3210 DC link over-voltage")
    robot.drives[LEFT].went("fault", before)
    robot.velocity = 0
    time.sleep(0.6)  # who went on commanding has to pause for a lease
    wait_for(robot.power, LIMIT)
    robot.drive()


@as_well
def test_f16_a_power_cycle_stops_both_and_brings_the_drive_back_to_ready(robot):
    robot.drive()
    robot.drives[RIGHT].end()
    off = time.monotonic()
    robot.start_drive(RIGHT)
    robot.stopped(LEFT, off, 0.3)
    robot.logged("node 6: up, switch on disabled", since=robot.server.log().index("node 6: up") + 1)
    time.sleep(0.5)  # while the client goes on commanding
    for drive in robot.drives.values():
        assert "operation enabled" not in [s for line in drive.told if line["time"] > off and (s := line.get("state"))]
    robot.velocity = 0
    time.sleep(0.6)
    wait_for(robot.power, LIMIT)
    robot.drive()
    assert robot.drives[RIGHT].states()[-1] == "operation enabled"


@as_well
def test_f15_a_drive_without_1016_stops_by_its_deadline_for_set_points(tmp_path):
    with Robot(tmp_path, eds=eds_without(tmp_path, "1016")) as robot:
        robot.up()
        robot.drive()
        killed = time.monotonic()
        robot.server.process.kill()
        for node in robot.drives:
            robot.stopped(node, killed, 0.5)
            assert {"silent": 0x8250}.items() <= next(
                line for line in robot.drives[node].told if "silent" in line
            ).items()


@as_well
def test_a_drive_that_nothing_would_stop_is_not_enabled(tmp_path):
    with Robot(tmp_path, eds=eds_without(tmp_path, "6007")) as robot:
        for node in robot.drives:
            robot.logged(f"node {node}: up")
        assert not robot.power()
        assert "operation enabled" not in robot.drives[LEFT].states()


@needs_kernel
def test_f13_after_bus_off_drives_have_stopped_and_come_back_on_request(robot):
    robot.drive()
    off = time.monotonic()
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as controller:
        controller.bind((KERNEL,))
        controller.send(struct.pack("=IB3x8s", 0x20000040, 8, bytes(8)))
    for node in robot.drives:
        robot.stopped(node, off, 0.3)
    robot.logged('driver "can_motor" failed: CAN bus bus-off')
    comes_back(robot)


@needs_kernel
def test_f13_an_interface_that_goes_down_and_up(robot):
    robot.drive()
    subprocess.run(["ip", "link", "set", KERNEL, "down"], check=True)
    try:
        robot.logged('driver "can_motor" failed: ')
        for drive in robot.drives.values():
            drive.end()  # python-can does not survive it
    finally:
        subprocess.run(["ip", "link", "set", KERNEL, "up"], check=True)
    for node in (LEFT, RIGHT):
        robot.start_drive(node)
    comes_back(robot)


def comes_back(robot):
    """Up, at rest although the client goes on, and enabled when it is asked for."""
    at = robot.server.log().rindex("failed")
    for node in robot.drives:
        robot.logged(f"node {node}: up", since=at)
    back = time.monotonic()
    time.sleep(0.5)
    for drive in robot.drives.values():
        assert not [line for line in drive.told if line["time"] > back and line.get("state") == "operation enabled"]
    robot.velocity = 0
    time.sleep(0.6)
    wait_for(robot.power, LIMIT)
    robot.drive()
