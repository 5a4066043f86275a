# SPDX-License-Identifier: Apache-2.0
"""MicroStrain's IMUs as their manuals describe them, at the far end of a pty; nothing is shared with the driver.

Single byte: 3DM-GX3-25 Data Communications Protocol, version 1.14. MIP: 3DM-GX5-25 DCP manual.
"""

import math
import os
import pty
import select
import struct
import threading
import time
import tty
from pathlib import Path


def rotation(roll, pitch, yaw):
    """M of the manuals, earth (north, east, down) to sensor, from aircraft angles: yaw clockwise, pitch nose up."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return [
        [cp * cy, cp * sy, -sp],
        [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
        [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
    ]


def turned(matrix, vector):
    return [sum(m * v for m, v in zip(row, vector, strict=True)) for row in matrix]


class Sensor:
    """A hundred samples a second, once it was told to."""

    def __init__(self, link):
        self.roll = self.pitch = self.yaw = 0.0  # rad, as an aircraft's
        self.rate = [0.0, 0.0, 0.0]  # rad/s about the sensor's axes
        self.link = link
        self.streams = False
        self.silent = False
        self.commands = []
        self.spoil = lambda packet: packet
        self.done = threading.Event()
        self.far, near = pty.openpty()
        tty.setraw(self.far)
        tty.setraw(near)
        Path(link).unlink(missing_ok=True)
        Path(link).symlink_to(os.ttyname(near))
        os.close(near)
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def vectors(self):
        matrix = rotation(self.roll, self.pitch, self.yaw)
        accel = turned(matrix, [0, 0, -1])  # g: what holds it up points away from down
        field = turned(matrix, [0.17, 0, 0.47])  # gauss
        return accel, self.rate, field, [value for row in matrix for value in row]

    def run(self):
        due = time.monotonic()
        pending = b""
        while not self.done.is_set():
            ready, _, _ = select.select([self.far], [], [], max(0.0, due - time.monotonic()))
            if ready:
                try:
                    pending = self.take(pending + os.read(self.far, 256))
                except OSError:  # nobody has the near end open
                    time.sleep(0.005)
            if time.monotonic() >= due:
                due += 0.01
                if self.streams and not self.silent:
                    self.write(self.spoil(self.sample()))

    def write(self, data):
        os.write(self.far, data)

    def unplug(self):
        self.done.set()
        self.thread.join()
        os.close(self.far)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if not self.done.is_set():
            self.unplug()


class SingleByte(Sensor):
    def sample(self):
        accel, rate, field, matrix = self.vectors()
        timer = int(time.monotonic() * 62500) & 0xFFFFFFFF
        body = struct.pack(">B18fI", 0xCC, *accel, *rate, *field, *matrix, timer)
        return body + struct.pack(">H", sum(body) & 0xFFFF)

    def take(self, data):
        while data:
            if data.startswith(b"\xfa\x75\xb4"):
                self.streams = False
                data = data[3:]
            elif data.startswith(b"\xc4\xc1\x29") and len(data) >= 4:
                self.streams = data[3] == 0xCC
                echo = struct.pack(">BBI", 0xC4, data[3], 0)
                self.write(echo + struct.pack(">H", sum(echo) & 0xFFFF))
                data = data[4:]
            elif len(data) < 4 and data[0] in (0xFA, 0xC4):
                break
            else:
                raise AssertionError(f"no command of a 3DM-GX3-25: {data.hex()}")
        return data


class Mip(Sensor):
    base_hz = 500

    def __init__(self, link, refuses=None):
        self.refuses = refuses
        self.decimation = {}
        super().__init__(link)

    @staticmethod
    def packet(descriptor_set, *fields):
        payload = b"".join(struct.pack("BB", len(data) + 2, kind) + data for kind, data in fields)
        body = struct.pack("4B", 0x75, 0x65, descriptor_set, len(payload)) + payload
        first = second = 0
        for byte in body:
            first = (first + byte) & 0xFF
            second = (second + first) & 0xFF
        return body + bytes([first, second])

    def sample(self):
        accel, rate, field, matrix = self.vectors()
        values = {0x04: accel, 0x05: rate, 0x06: field, 0x09: matrix, 0x0E: None}
        fields = [(0x0E, struct.pack(">I", 0))] if 0x0E in self.decimation else []
        for kind in self.decimation:
            if values[kind] is not None:
                fields.append((kind, struct.pack(f">{len(values[kind])}f", *values[kind])))
        return self.packet(0x80, *fields)

    def take(self, data):
        while len(data) >= 4:
            assert data[:2] == b"\x75\x65", data.hex()
            size = data[3] + 6
            if len(data) < size:
                break
            body, payload = data[:size], data[4 : size - 2]
            assert self.packet(body[2], (payload[1], payload[2:])) == body, "checksum"
            self.answer(body[2], payload[1], payload[2:])
            data = data[size:]
        return data

    def answer(self, descriptor_set, command, arguments):
        self.commands.append((descriptor_set, command, arguments))
        error = 3 if (descriptor_set, command) == self.refuses else 0
        fields = [(0xF1, bytes([command, error]))]
        match (descriptor_set, command):
            case (0x01, 0x02):
                self.streams = False
            case (0x01, 0x06):
                self.streams = bool(self.decimation)
            case (0x0C, 0x06):
                fields.append((0x83, struct.pack(">H", self.base_hz)))
            case (0x0C, 0x08):
                assert arguments[0] == 1
                assert len(arguments) == 2 + 3 * arguments[1]
                self.decimation = dict(struct.iter_unpack(">BH", arguments[2:]))
            case (0x0C, 0x11):
                assert arguments == b"\x01\x01\x01"
            case _:
                raise AssertionError(f"no command of this sensor: {descriptor_set:02x} {command:02x}")
        self.write(self.packet(descriptor_set, *fields))
