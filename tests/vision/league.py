# SPDX-License-Identifier: Apache-2.0
"""A field for regista-vision-bridge: packets of the league packed here by hand, multicast on lo, and robots' servers
that understand just enough of Player 3 to be told where they are."""

import json
import math
import os
import selectors
import socket
import struct
import subprocess
import threading
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")).resolve()
BRIDGE = BIN / "regista-vision-bridge"
DATA = ROOT / "tests/data"

YELLOW, BLUE = 6, 7  # field numbers in SSL_DetectionFrame
VISION_GROUP, REFEREE_GROUP = "224.5.23.2", "224.5.23.1"
DATA_KIND, COMMAND, REQUEST, ACK, NACK = 1, 2, 3, 4, 6


# ---- Protocol buffers: tag = number << 3 | type, little-endian


def varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def whole(number, value):
    return varint(number << 3) + varint(value)


def float32(number, value):
    return varint(number << 3 | 5) + struct.pack("<f", value)


def float64(number, value):
    return varint(number << 3 | 1) + struct.pack("<d", value)


def nested(number, content):
    return varint(number << 3 | 2) + varint(len(content)) + content


def unpack(message):
    """[(field number, value)]"""
    position = 0

    def take_varint():
        nonlocal position
        value = shift = 0
        while True:
            byte = message[position]
            position += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    found = []
    while position < len(message):
        key = take_varint()
        kind = key & 7
        if kind == 0:
            found.append((key >> 3, take_varint()))
            continue
        size = {1: 8, 5: 4}.get(kind) or take_varint()
        value = message[position : position + size]
        position += size
        if kind == 1:
            value = struct.unpack("<d", value)[0]
        elif kind == 5:
            value = struct.unpack("<f", value)[0]
        found.append((key >> 3, value))
    return found


def detection(camera, number, t_capture, robots, balls=(), t_sent=None):
    """An SSL_WrapperPacket. robots: [(team, id, x in m, y in m, heading)], balls: [(x, y)]"""
    frame = whole(1, number) + float64(2, t_capture) + float64(3, t_capture if t_sent is None else t_sent)
    frame += whole(4, camera)
    for x, y in balls:
        frame += nested(5, float32(1, 1) + float32(3, 1e3 * x) + float32(4, 1e3 * y) + float32(6, 0) + float32(7, 0))
    for team, robot, x, y, heading in robots:
        content = float32(1, 1) + whole(2, robot) + float32(3, 1e3 * x) + float32(4, 1e3 * y) + float32(5, heading)
        frame += nested(team, content + float32(6, 0) + float32(7, 0))
    return nested(1, frame)


def referee(command, counter=1):
    return whole(1, 0) + whole(2, 0) + whole(4, command) + whole(5, counter) + whole(6, 0)


def tracked(uuid, name, number, timestamp, robots):
    """A TrackerWrapperPacket. robots: [(team: 1 or 2, id, x, y, heading)]"""
    frame = whole(1, number) + float64(2, timestamp)
    for team, robot, x, y, heading in robots:
        identity = nested(1, whole(1, robot) + whole(2, team))
        frame += nested(4, identity + nested(2, float32(1, x) + float32(2, y)) + float32(3, heading))
    return nested(1, uuid.encode()) + nested(2, name.encode()) + nested(3, frame)


def records(path):
    """[(time in s, datagram)] of a log file of the league."""
    data = path.read_bytes()
    assert data[:16] == b"SSL_LOG_FILE\0\0\0\1"
    position, found = 16, []
    while position < len(data):
        stamp, _, size = struct.unpack_from(">qii", data, position)
        found.append((stamp * 1e-9, data[position + 16 : position + 16 + size]))
        position += 16 + size
    return found


# ---- Multicast, never beyond lo


class Sender:
    def __init__(self, group, port):
        self.to = (group, port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))

    def send(self, packet):
        self.socket.sendto(packet, self.to)

    def close(self):
        self.socket.close()


def free_udp_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


# ---- Robots


class Robots:
    """Servers as stock Player's, one port a robot, and what came: [(monotonic time, x, y, heading, age)] for each."""

    def __init__(self, count):
        self.selector = selectors.DefaultSelector()
        self.listeners = []
        self.poses = [[] for _ in range(count)]
        self.stops = [0] * count
        self.deaf = set()  # robots that no longer read
        self.opening = set()  # robots whose position2d:0 never opens
        self.asked = [[] for _ in range(count)]  # index of each device that was to be opened
        for number in range(count):
            listener = socket.create_server(("127.0.0.1", 0))
            self.selector.register(listener, selectors.EVENT_READ, (self.accept, number))
            self.listeners.append(listener)
        self.ports = [listener.getsockname()[1] for listener in self.listeners]
        self.peers = {}
        self.peer_of = {}
        self.running = True
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.running = False
        self.thread.join()
        for listener in self.listeners:
            listener.close()
        for peer in self.peers:
            peer.close()

    def run(self):
        while self.running:
            for key, _ in self.selector.select(0.05):
                action, number = key.data
                action(key.fileobj, number)

    def accept(self, listener, number):
        peer, _ = listener.accept()
        peer.sendall(b"Player v.3.1.0".ljust(32, b"\0"))
        self.peers[peer] = b""
        self.peer_of[peer] = number
        self.selector.register(peer, selectors.EVENT_READ, (self.read, number))

    def read(self, peer, number):
        now = time.monotonic()
        if number in self.deaf:
            self.selector.unregister(peer)
            return
        try:
            more = peer.recv(1 << 16)
        except ConnectionResetError:
            more = b""
        if not more:
            self.selector.unregister(peer)
            del self.peers[peer], self.peer_of[peer]
            peer.close()
            return
        data = self.peers[peer] + more
        while len(data) >= 40:
            _, robot, interface, index, kind, subtype, _, sequence, size = struct.unpack_from(">6IdII", data)
            if len(data) < 40 + size:
                break
            body, data = data[40 : 40 + size], data[40 + size :]
            if kind == COMMAND:
                self.command(number, interface, index, subtype, body, now)
            elif kind == REQUEST:
                if (interface, subtype) == (1, 3):
                    index_asked = struct.unpack_from(">4I", body)[3]
                    self.asked[number].append(index_asked)
                    if index_asked == 0 and number in self.opening:
                        continue
                known = interface == 1 and subtype in (1, 3, 5, 10)  # DEVLIST, DEV, DATAMODE, ADD_REPLACE_RULE
                answer = body[:20] + struct.pack(">II", 5, 5) + b"fake\0\0\0\0" if subtype == 3 else b""
                if subtype == 1:
                    answer = struct.pack(">II", 0, 0)
                header = (0, robot, interface, index, ACK if known else NACK, subtype, 0, sequence, len(answer))
                peer.sendall(struct.pack(">6IdII", *header) + answer)
        self.peers[peer] = data

    def hang_up(self):
        """On all that are connected."""
        for peer in list(self.peers):
            self.selector.unregister(peer)
            peer.close()
            del self.peers[peer], self.peer_of[peer]

    def tell_turn(self, number, rate):
        """As the robot's odometry: position2d:0 turns at `rate` [rad/s] now."""
        body = struct.pack(">6dI", 0, 0, 0, 0, 0, rate, 0)
        header = struct.pack(">6IdII", 0, 0, 4, 0, DATA_KIND, 1, time.time(), 0, len(body))
        for peer, of in list(self.peer_of.items()):
            if of == number:
                peer.sendall(header + body)

    def command(self, number, interface, index, subtype, body, now):
        assert (interface, subtype) == (4, 1), "only velocity commands of position2d"
        if index == 0:
            self.stops[number] += 1
            return
        x, y, heading, state, age = struct.unpack(">3dId", body)  # the age stands behind what a stock server reads
        assert state == 1
        self.poses[number].append((now, x, y, heading, age))


# ---- The bridge


class Bridge:
    """regista-vision-bridge on lo, on ports of its own. robots: [(team, id, port)], or with the device's index."""

    def __init__(self, folder, robots, keys="", arguments=(), vision_port=None, usual_tracked_port=False):
        """A port of 0: any; None: the one that everybody uses."""
        self.vision_port, self.referee_port, self.tracked_port = (free_udp_port() for _ in range(3))
        self.vision_port = vision_port or self.vision_port
        tracked_key = "" if usual_tracked_port else f"tracked_port {self.tracked_port}"
        config = folder / "bridge.cfg"
        lines = [
            f'vision ( interfaces ["lo"] port {self.vision_port} referee_port {self.referee_port}',
            f"{tracked_key} status_port 0 {keys} )",
        ]
        for team, robot, port, *index in robots:
            index = index[0] if index else 1
            lines.append(f'robot ( team "{team}" id {robot} host "127.0.0.1" port {port} index {index} )')
        config.write_text("\n".join(lines).replace(" )", "\n)"))
        self.log_file = folder / "bridge.log"
        self.log_stream = self.log_file.open("w")
        self.process = subprocess.Popen(
            [BRIDGE, *arguments, config], stdout=subprocess.PIPE, stderr=self.log_stream, text=True
        )
        ready = self.process.stdout.readline()
        assert ready == "regista-vision-bridge: ready\n", ready + self.log()
        self.vision = Sender(VISION_GROUP, self.vision_port)
        self.referee = Sender(REFEREE_GROUP, self.referee_port)
        self.tracked = Sender(VISION_GROUP, self.tracked_port)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for sender in (self.vision, self.referee, self.tracked):
            sender.close()
        self.process.terminate()
        code = self.process.wait(10)
        self.process.stdout.close()
        self.log_stream.close()
        assert code == 0, self.log()

    def log(self):
        return self.log_file.read_text()

    def get(self, path="/"):
        url = next(word for word in wait_for(lambda: "http" in self.log() and self.log()).split() if "http" in word)
        with urllib.request.urlopen(url.rstrip("/") + path, timeout=5) as answer:
            return answer.read().decode()

    def status(self):
        return json.loads(self.get())

    def connected(self):
        wait_for(lambda: all(robot["connected"] for robot in self.status()["robots"]))

    def cpu(self):
        """Processor time so far [s]."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for(look, timeout=10.0):
    """What `look` returns, once that is true."""
    end = time.monotonic() + timeout
    while not (found := look()):
        if time.monotonic() > end:
            raise TimeoutError("it did not happen")
        time.sleep(0.005)
    return found


def deviation(values):
    mean = sum(values) / len(values)
    return math.sqrt(sum((value - mean) ** 2 for value in values) / len(values))
