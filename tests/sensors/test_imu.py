# SPDX-License-Identifier: Apache-2.0
"""The whole way: packets by another hand, a serial line (a pty), regista-server, TCP, a client of packed bytes."""

import math
import random
import struct
import sys
import time
from pathlib import Path

import pytest
from microstrain import Mip, SingleByte

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))
from regista_process import ACK, BIN, DATA, NACK, Client, ServerProcess, wait_for

DRIVERS = BIN.parent / "lib/regista"
IMU = 60
STATE, CALIB, QUAT, EULER = 1, 2, 3, 4
G = 9.80665

SENSORS = pytest.mark.parametrize(("sensor", "protocol"), [(SingleByte, "single_byte"), (Mip, "mip")])


class ImuServer(ServerProcess):
    def __init__(self, folder, protocol, keys=""):
        link = f'port "{folder / "imu"}" protocol "{protocol}"'
        super().__init__(folder, f'driver ( name "imu" provides ["imu:0"] {link} {keys} )\n', DRIVERS)


class Listener:
    def __init__(self, port):
        self.client = Client(port)

    def open(self):
        return self.client.ask(1, 0, 3, struct.pack(">7I", 0, 0, IMU, 0, 1, 0, 0))[2]

    def next(self, subtype, true=lambda _: True):
        end = time.monotonic() + 10
        while time.monotonic() < end:
            message = self.client.receive()
            if message[2] == DATA and message[0] == IMU and message[3] == subtype:
                form = {STATE: ">6d", CALIB: ">9f", QUAT: ">13f", EULER: ">9f3d"}[subtype]
                data = struct.unpack(form, message[5])
                if true(data):
                    return data
        raise TimeoutError("it did not come")


def near(a, b, tolerance=1e-4):
    assert len(a) == len(b)
    assert all(abs(x - y) < tolerance for x, y in zip(a, b, strict=True)), f"{a} is not {b}"


@SENSORS
def test_axes_and_units_are_those_of_the_house(tmp_path, sensor, protocol):
    with sensor(tmp_path / "imu") as imu, ImuServer(tmp_path, protocol) as server:
        imu.rate = [0.1, 0.2, 0.3]
        listener = Listener(server.port)
        assert listener.open() == ACK
        # Level, its nose to the north: the house's heading is 90°; right is minus y, down minus z.
        near(listener.next(CALIB), [0, 0, G, 0.1, -0.2, -0.3, 0.17, 0, -0.47])
        near(listener.next(STATE), [0, 0, 0, 0, 0, math.pi / 2])
        imu.yaw = math.radians(100)  # east, and 10° farther to the right
        near(listener.next(STATE, lambda d: d[5] < 1), [0, 0, 0, 0, 0, -math.radians(10)])
        imu.yaw = -math.radians(90)  # west
        near(listener.next(STATE, lambda d: abs(d[5]) > 3), [0, 0, 0, 0, 0, math.pi])
        imu.yaw, imu.pitch = math.radians(90), math.radians(20)  # nose up: the specific force leans to the front
        near(listener.next(STATE, lambda d: d[4] < -0.3), [0, 0, 0, 0, -math.radians(20), 0])
        near(listener.next(CALIB)[:3], [G * math.sin(imu.pitch), 0, G * math.cos(imu.pitch)])
        imu.pitch, imu.roll = 0, math.radians(30)  # right side down, and so the left side up
        near(listener.next(STATE, lambda d: d[3] > 0.5), [0, 0, 0, math.radians(30), 0, 0])
        near(listener.next(CALIB)[:3], [0, G * math.sin(imu.roll), G * math.cos(imu.roll)])

        assert listener.client.ask(IMU, 0, 1, struct.pack(">I", QUAT))[2] == ACK
        near(listener.next(QUAT)[9:], [math.cos(imu.roll / 2), math.sin(imu.roll / 2), 0, 0])
        assert listener.client.ask(IMU, 0, 1, struct.pack(">I", EULER))[2] == ACK
        near(listener.next(EULER)[9:], [imu.roll, 0, 0])
        assert listener.client.ask(IMU, 0, 1, struct.pack(">I", 5))[2] == NACK
        listener.next(CALIB)  # still


@SENSORS
def test_mounting_and_declination_are_taken_away(tmp_path, sensor, protocol):
    # Upside down, its nose to the robot's left; magnetic north is 4° east of the true one.
    keys = "mount [180 0 90] declination 4"
    with sensor(tmp_path / "imu") as imu, ImuServer(tmp_path, protocol, keys) as server:
        imu.roll = math.pi
        imu.yaw = math.radians(-4)  # the sensor's nose to the true north, and so the robot's to the east
        imu.rate = [0.1, 0.2, 0.3]
        listener = Listener(server.port)
        assert listener.open() == ACK
        # The sensor's x is the robot's y, its z is up, and so its y (z cross x) is the robot's minus x.
        near(listener.next(CALIB)[:6], [0, 0, G, -0.2, 0.1, 0.3])
        near(listener.next(STATE, lambda d: abs(d[5]) < 1), [0, 0, 0, 0, 0, 0])


@SENSORS
def test_lost_added_and_flipped_bytes_are_survived_and_nothing_false_goes_on(tmp_path, sensor, protocol):
    chance = random.Random(7)
    with sensor(tmp_path / "imu") as imu, ImuServer(tmp_path, protocol) as server:

        def spoil(packet):
            kind = chance.randrange(4)
            at = chance.randrange(len(packet))
            if kind == 0:
                return packet[:at] + packet[at + 1 :]
            if kind == 1:
                return packet[:at] + chance.randbytes(3) + packet[at:]
            if kind == 2:
                return packet[:at] + bytes([packet[at] ^ 1 << chance.randrange(8)]) + packet[at + 1 :]
            return packet

        imu.rate = [0.1, 0.2, 0.3]
        imu.spoil = spoil
        listener = Listener(server.port)
        assert listener.open() == ACK
        for _ in range(40):
            near(listener.next(CALIB), [0, 0, G, 0.1, -0.2, -0.3, 0.17, 0, -0.47])
        assert "failed" not in server.log()


@SENSORS
def test_unplugged_and_plugged_in_again(tmp_path, sensor, protocol):
    imu = sensor(tmp_path / "imu")
    try:
        with ImuServer(tmp_path, protocol) as server:
            listener = Listener(server.port)
            assert listener.open() == ACK
            listener.next(CALIB)
            imu.unplug()
            wait_for(lambda: 'driver "imu" failed: ' in server.log())
            assert str(tmp_path / "imu") in server.log()
            imu = sensor(tmp_path / "imu")
            imu.rate = [0, 0, -1]
            listener.next(CALIB, lambda d: d[5] > 0.9)
    finally:
        imu.__exit__()


@SENSORS
def test_a_silent_sensor_is_told_and_started_again(tmp_path, sensor, protocol):
    with sensor(tmp_path / "imu") as imu, ImuServer(tmp_path, protocol, "timeout 0.3") as server:
        listener = Listener(server.port)
        assert listener.open() == ACK
        listener.next(CALIB)
        imu.streams = False  # as after a loss of power
        wait_for(lambda: "nothing at all: is the IMU on, is `port` right?" in server.log())
        listener.next(CALIB)


def test_the_other_protocol_is_told(tmp_path):
    with SingleByte(tmp_path / "imu") as imu, ImuServer(tmp_path, "mip", "timeout 0.5") as server:
        imu.take = lambda _: b""
        imu.streams = True
        listener = Listener(server.port)
        assert listener.open() == ACK
        wait_for(lambda: "only other bytes: are `baud` and `protocol` right?" in server.log())


def test_mip_sensor_is_set_to_the_rate_that_is_asked_for(tmp_path):
    with Mip(tmp_path / "imu") as imu, ImuServer(tmp_path, "mip", "sample_rate 50") as server:
        listener = Listener(server.port)
        assert listener.open() == ACK
        listener.next(CALIB)
        assert imu.decimation == {0x04: 10, 0x05: 10, 0x06: 10, 0x09: 10}


def test_a_refused_command_is_told_in_words(tmp_path):
    with Mip(tmp_path / "imu", refuses=(0x0C, 0x08)), ImuServer(tmp_path, "mip") as server:
        listener = Listener(server.port)
        assert listener.open() == ACK
        wait_for(lambda: "refused 3DM command 0x08: invalid parameter (3)" in server.log())
