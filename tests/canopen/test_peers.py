# SPDX-License-Identifier: Apache-2.0
"""regista-can against python-canopen, which shares no code with it: as its slave, and as its master.

Over a bus in user space, or with REGISTA_CAN=vcan0 over the kernel's (tests/vm/with-vcan).
"""

import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

can = pytest.importorskip("can")
canopen = pytest.importorskip("canopen")

ROOT = Path(__file__).resolve().parents[2]
PEER = ROOT / "tests/canopen/peer"
DATA = ROOT / "tests/data/canopen"
PROGRAM = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-can"
KERNEL = os.environ.get("REGISTA_CAN")
EDS = DATA / "drive.eds"
LIMIT = 60  # [s], of anything that a test waits for
PATIENCE = 10.0  # [s], with an answer: an emulated kernel has one processor of a busy machine


@contextlib.contextmanager
def running(*command):
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(LIMIT)


def wait_for_line(process, wanted):
    for line in process.stdout:
        if wanted in line:
            return line
    raise AssertionError(f"it ended before it said '{wanted}': {process.stderr.read()}")


class Bus:
    """Where everybody meets: names of it for our program and for python-can."""

    def __init__(self, port):
        self.ours = KERNEL or f"socketcand://127.0.0.1:{port}/can0"
        self.arguments = ["--interface", "socketcan" if KERNEL else "socketcand", "--channel", KERNEL or "can0"]
        self.arguments += [] if KERNEL else ["--port", str(port)]
        self.port = port

    def network(self):
        network = canopen.Network()
        if KERNEL:
            network.connect(interface="socketcan", channel=KERNEL)
        else:
            network.connect(interface="socketcand", channel="can0", host="127.0.0.1", port=self.port, tcp_tune=True)
        return network

    def run(self, *arguments, code=0, timeout=PATIENCE):
        command = [PROGRAM, "-b", self.ours, "--timeout", str(timeout), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
        assert done.returncode == code, done.stderr
        return done.stdout if code == 0 else done.stderr

    def start(self, *arguments):
        return running(PROGRAM, "-b", self.ours, "--timeout", str(PATIENCE), *map(str, arguments))


@pytest.fixture(scope="module")
def bus():
    if KERNEL:
        yield Bus(0)
        return
    with running(sys.executable, PEER / "hub.py", "--port", "0") as hub:
        yield Bus(int(wait_for_line(hub, "ready").split()[0]))


# --- python-canopen is the slave


@pytest.fixture(scope="module")
def drive(bus):
    with running(sys.executable, PEER / "drive.py", *bus.arguments, "--node", "5", "--node", "6") as process:
        wait_for_line(process, "ready")
        yield process


def test_scan_finds_the_drives(bus, drive):
    lines = bus.run("scan", "--last", 20, timeout=2).splitlines()
    assert [line.split("  ")[0] for line in lines] == ["node 5", "node 6"]
    assert "profile 402  'CiA 402 velocity drive for tests'" in lines[0]
    assert "vendor 0x000000F4 product 0x00000402 revision 0x00010001 serial 0x12345678" in lines[1]


def test_read_and_write_by_name_and_number(bus, drive):
    assert bus.run("read", 5, "device type", "--eds", EDS) == "131474\n"
    assert bus.run("read", 5, "1000", "--type", "unsigned32") == "131474\n"
    assert bus.run("read", 5, "1000") == "92 01 02 00\n"
    bus.run("write", 5, "Profile acceleration", "7777", "--eds", EDS)
    assert bus.run("read", 5, "6083", "--eds", EDS) == "7777\n"
    bus.run("write", 5, "target torque", "-12", "--eds", EDS)
    assert bus.run("read", 5, "6071", "--eds", EDS) == "-12\n"
    bus.run("write", 5, "gain", "2.25", "--eds", EDS)
    assert bus.run("read", 5, "gain", "--eds", EDS) == "2.250000\n"
    note = "a note that takes several segments, each of seven bytes"
    bus.run("write", 5, "note", note, "--eds", EDS)
    assert bus.run("read", 5, "note", "--eds", EDS) == note + "\n"


@pytest.mark.parametrize("transfer", [[], ["--block"]])
@pytest.mark.parametrize("size", [1, 4, 5, 7, 889, 890, 3000])
def test_any_size_goes_both_ways(bus, drive, tmp_path, size, transfer):
    sent, back = tmp_path / "sent", tmp_path / "back"
    sent.write_bytes(os.urandom(size))
    bus.run("write", 6, "2001", "--file", sent, *transfer)
    bus.run("read", 6, "2001", "--file", back, *transfer)
    assert back.read_bytes() == sent.read_bytes()


def test_blocks_go_in_segments_to_a_node_that_has_none(bus, tmp_path):
    """python-canopen's own server refuses a block download, and answers a block upload with segments."""
    sent, back = tmp_path / "sent", tmp_path / "back"
    sent.write_bytes(os.urandom(100))
    with running(sys.executable, PEER / "drive.py", *bus.arguments, "--node", "7", "--no-blocks") as process:
        wait_for_line(process, "ready")
        bus.run("write", 7, "2001", "--file", sent, "--block")
        bus.run("read", 7, "2001", "--file", back, "--block")
    assert back.read_bytes() == sent.read_bytes()


def test_aborts_are_told_in_words(bus, drive):
    error = bus.run("write", 5, "1000", "01 00 00 00", code=1)
    assert error == "regista-can: node 5: write 1000:00: SDO abort 0x06010002: the object is read-only\n"
    assert "0x06020000: no such object" in bus.run("read", 5, "5FFF", code=1)
    assert "0x06090011: no such sub-index" in bus.run("read", 5, "1018:09", code=1)
    assert "no answer for 50 ms" in bus.run("read", 77, "1000", code=1, timeout=0.05)


def test_watch_follows_the_state_machine_and_emergencies(bus, drive):
    with bus.start("watch", 6) as watch:
        wait_for_line(watch, "switch on disabled")
        for word, state in (6, "ready to switch on"), (7, "switched on"), (15, "operation enabled"):
            bus.run("write", 6, "6040", word, "--type", "unsigned16")
            wait_for_line(watch, state)
        bus.run("write", 6, "2002", "0x3210", "--type", "unsigned16")
        assert "EMCY 0x3210 DC link over-voltage (reg 0x11: generic, communication)" in wait_for_line(watch, "EMCY")
        wait_for_line(watch, "0x3210")
        bus.run("write", 6, "6040", 0, "--type", "unsigned16")
        bus.run("write", 6, "6040", 0x80, "--type", "unsigned16")
        wait_for_line(watch, "switch on disabled")


def test_nmt_and_dump_in_words(bus, drive):
    with bus.start("dump", "--words") as dump:
        assert "listening" in dump.stderr.readline()
        bus.run("nmt", "start", 5)
        line = wait_for_line(dump, "NMT start node 5")
        assert re.match(r"\(\d+\.\d{6}\) \S+ 000#0105  NMT start node 5$", line)
        wait_for_line(dump, "node 5 TPDO1 ")
        bus.run("nmt", "pre-operational", 5)
        wait_for_line(dump, "NMT pre-operational node 5")


def test_configure_writes_a_dcf_and_reads_it_back(bus, drive, tmp_path):
    dcf = tmp_path / "drive.dcf"
    dcf.write_text(
        EDS.read_text()
        .replace("[6083]\n", "[6083]\nParameterValue=1234\n")
        .replace("[1800sub5]\n", "[1800sub5]\nParameterValue=20\n")
    )
    assert bus.run("configure", 5, dcf).endswith("objects written and read back\n")
    assert bus.run("read", 5, "6083", "--eds", EDS) == "1234\n"
    assert bus.run("read", 5, "1800:05", "--eds", EDS) == "20\n"
    concise = tmp_path / "concise"
    bus.run("configure", 5, dcf, "--concise", concise)
    assert b"\x83\x60\x00\x04\x00\x00\x00\xd2\x04\x00\x00" in concise.read_bytes()


# --- python-canopen is the master


@pytest.fixture(scope="module")
def ours(bus):
    with bus.start("device", 9, EDS) as process:
        wait_for_line(process, "ready")
        network = bus.network()
        node = network.add_node(9, str(EDS))
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        yield node
        network.disconnect()


def test_our_device_is_read_and_written(ours):
    assert ours.sdo["Device type"].raw == 0x20192
    assert ours.sdo[0x1008].raw == "CiA 402 velocity drive for tests"
    assert ours.sdo[0x1018][4].raw == 0x12345678
    ours.sdo["Target torque"].raw = -300
    assert ours.sdo["Target torque"].raw == -300
    assert ours.sdo["Gain"].raw == 1.5
    assert ours.sdo[0x2006][2].raw == -7


@pytest.mark.parametrize("block", [False, True])
@pytest.mark.parametrize("size", [1, 4, 5, 7, 889, 890, 3000])
def test_our_device_takes_any_size(ours, size, block):
    data = os.urandom(size)
    with ours.sdo.open(0x2001, 0, "wb", size=size, block_transfer=block) as stream:
        stream.write(data)
    with ours.sdo.open(0x2001, 0, "rb", block_transfer=block) as stream:
        assert stream.read() == data


@pytest.mark.parametrize(
    ("index", "sub", "value", "code"),
    [
        (0x1000, 0, b"\0\0\0\0", 0x06010002),
        (0x5FFF, 0, b"\0", 0x06020000),
        (0x1018, 9, b"\0", 0x06090011),
        (0x6040, 0, b"\0\0\0", 0x06070012),
        (0x6040, 0, b"\0", 0x06070013),
        (0x2007, 0, b"\x65", 0x06090031),
        (0x2007, 0, b"\xf5", 0x06090032),
        (0x1600, 1, b"\0\0\0\0", 0x06010000),
    ],
)
def test_our_device_refuses(ours, index, sub, value, code):
    with pytest.raises(canopen.SdoAbortedError) as error:
        ours.sdo.download(index, sub, value)
    assert error.value.code == code


def test_our_device_refuses_to_tell_a_secret(ours):
    with pytest.raises(canopen.SdoAbortedError) as error:
        ours.sdo.upload(0x2005, 0)
    assert error.value.code == 0x06010001


def test_our_device_beats_and_follows_nmt(ours):
    ours.sdo["Producer heartbeat time"].raw = 50
    ours.nmt.wait_for_heartbeat(LIMIT)
    for state in "OPERATIONAL", "STOPPED", "PRE-OPERATIONAL":
        ours.nmt.state = state
        deadline = time.monotonic() + LIMIT
        while ours.nmt.state != state and time.monotonic() < deadline:
            ours.nmt.wait_for_heartbeat(LIMIT)
        assert ours.nmt.state == state
    booted = threading.Event()  # not wait_for_bootup(), which misses one that comes before it waits
    ours.nmt.add_heartbeat_callback(lambda state: state == 0 and booted.set())
    ours.nmt.state = "RESET"
    assert booted.wait(LIMIT)


def test_our_device_maps_pdos_and_sends_them_on_sync(ours):
    ours.tpdo.read()
    ours.rpdo.read()
    assert [variable.index for variable in ours.tpdo[1]] == [0x6041, 0x606C]
    temperatures = ours.tpdo[2]
    temperatures.clear()
    temperatures.add_variable(0x2000, 1)
    temperatures.add_variable(0x2000, 2)
    temperatures.trans_type = 1
    temperatures.event_timer = 0
    temperatures.enabled = True
    temperatures.save()
    heard = []
    temperatures.add_callback(lambda pdo: heard.append([variable.raw for variable in pdo]))
    ours.nmt.state = "OPERATIONAL"
    for _ in range(10):
        ours.network.sync.transmit()
        time.sleep(0.02)
    deadline = time.monotonic() + LIMIT
    while len(heard) < 10 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert heard == [[25, 30]] * 10
    commands = ours.rpdo[1]
    commands["Controlword"].raw = 6
    commands["Target velocity"].raw = -500
    commands.transmit()
    while ours.sdo["Target velocity"].raw != -500:
        assert time.monotonic() < deadline
    assert ours.sdo["Controlword"].raw == 6
    ours.nmt.state = "PRE-OPERATIONAL"


def test_our_device_tells_emergencies(ours):
    ours.emcy.reset()
    ours.sdo[0x2002].raw = 0x4310
    deadline = time.monotonic() + LIMIT
    while not ours.emcy.log and time.monotonic() < deadline:
        time.sleep(0.01)
    assert [(emcy.code, emcy.register) for emcy in ours.emcy.log] == [(0x4310, 1)]
    assert ours.sdo[0x1003][1].raw == 0x4310
    ours.sdo[0x2002].raw = 0


def test_our_device_gets_a_node_id_by_lss(bus):
    network = bus.network()
    try:
        with bus.start("device", 255, EDS) as device:
            wait_for_line(device, "ready")
            network.lss.RESPONSE_TIMEOUT = 0.3
            found, identity = network.lss.fast_scan()
            assert found
            assert identity == [0xF4, 0x402, 0x10001, 0x12345678]
            assert network.lss.inquire_node_id() == 255
            network.lss.configure_node_id(33)
            assert network.lss.inquire_lss_address(0x5D) == 0x12345678
            network.lss.send_switch_state_global(network.lss.WAITING_STATE)
            wait_for_line(device, "pre-operational")
            node = network.add_node(33, str(EDS))
            assert node.sdo["Device type"].raw == 0x20192
    finally:
        network.disconnect()


# --- the two readers of EDS files


@pytest.mark.parametrize("name", ["drive.eds", "DS301_profile.eds", "cia402_slave.eds"])
def test_an_eds_is_read_as_python_canopen_reads_it(name, tmp_path):
    done = subprocess.run([PROGRAM, "objects", DATA / name, "--node", "3"], capture_output=True, text=True, check=True)
    ours = {}
    for line in done.stdout.splitlines():
        place, kind, access, mappable, value, label = line.split("\t")
        ours[place] = (int(kind, 16), access, mappable == "pdo", value, label)
    theirs = {}
    # It does not take an empty number for none.
    text = re.sub(r"^(VendorNumber|ProductNumber)=$", r"\1=0", (DATA / name).read_text(), flags=re.MULTILINE)
    (tmp_path / name).write_text(text)
    dictionary = canopen.import_od(str(tmp_path / name), node_id=3)
    for index, found in dictionary.items():
        if index < 0x20:  # the dummies of mappings
            continue
        variables = [found] if isinstance(found, canopen.objectdictionary.ODVariable) else found.values()
        for variable in variables:
            theirs[f"{index:04X}:{variable.subindex:02X}"] = variable
    assert ours.keys() >= theirs.keys()
    assert theirs
    for place, variable in theirs.items():
        kind, access, mappable, value, label = ours[place]
        assert kind == variable.data_type, place
        known_as = {"rwr": "rw", "rww": "rw"}
        if place.startswith("2006:"):  # CompactSubObj: it knows neither its names nor its access (CiA 306-1, 4.6.4)
            continue
        assert access == known_as.get(variable.access_type, variable.access_type), place
        assert mappable == variable.pdo_mappable, place
        assert label.split(" / ")[-1].strip() == variable.name.split(".")[-1].strip(), place
        if variable.default is not None and kind not in (0x0A, 0x0B, 0x0F):
            assert value == (f"{variable.default:.6f}" if kind in (0x08, 0x11) else str(variable.default)), place
