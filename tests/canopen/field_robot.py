# SPDX-License-Identifier: Apache-2.0
"""A field robot of real processes: drives on python-canopen, gpsd with a receiver, an IMU on a serial line, and
regista-server, which knows of the world only what these tell. What they tell agrees with one truth: the wheels turn as
the drives say, and the robot goes where its wheels bring it.

field_robot.py [--runs N]    drives the scenarios of docs/reproduction.md and prints what came of them, as a table
"""

import argparse
import contextlib
import dataclasses
import itertools
import json
import math
import os
import random
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/faults"), str(ROOT / "tests/sensors")]
from microstrain import SingleByte  # noqa: E402
from receiver import Gpsd, Receiver, free_port  # noqa: E402
from regista_process import ACK, BIN, DATA, POSITION2D, Client, ServerProcess, wait_for  # noqa: E402

PEER = ROOT / "tests/canopen/peer"
KERNEL = os.environ.get("REGISTA_CAN")
PLANNER, POWER_ON, SET_ODOM, GET_BOOL = 44, 2, 5, 248
SET_MISSION, GET_MISSION, GO_ON, RUN = 100, 101, 102, 100
WAIT, RELAY, ASK = range(3)
STATES = ["none", "ready", "driving", "working", "asking", "paused", "failed", "finished"]
REPORT = 0.02  # [s] between two of a drive


@dataclasses.dataclass(frozen=True)
class Machine:
    """What regista is told of it, and how it really is."""

    left: tuple  # node ids
    right: tuple
    wheel_radius_m: float
    track_m: float
    gear: float
    true_radii_m: tuple  # left, right
    true_track_m: float
    slip: float  # [m] sd of a wheel's way after one metre


# 50 kg on two wheels, as in programs/reproduce/waypoints.cpp; its wheels are not quite what they should be.
FIELD_ROBOT = Machine((5,), (6,), 0.15, 0.6, 40, (0.1505, 0.1495), 0.606, 0.01)
# Four wheels that skid and turn it 1.19 times less than their track says (Kvalheim et al. 2017): regista knows that.
ROVER = Machine((5, 7), (6, 8), 0.035, 1.19 * 0.30, 9, (0.035, 0.035), 1.19 * 0.30, 0.01)


class World:
    """Where the robot is."""

    def __init__(self, machine, seed):
        self.machine = machine
        self.random = random.Random(seed)
        self.lock = threading.Lock()
        self.pose = (0.0, 0.0, 0.0)
        self.turns = {}
        self.rpm = dict.fromkeys(machine.left + machine.right, 0)
        self.late = {}  # [s] by when: what the drives told came so much later

    def side(self, node):
        """(which, how many wheels are there)"""
        machine = self.machine
        return (0, len(machine.left)) if node in machine.left else (1, len(machine.right))

    def turned(self, node, turns, rpm, told):
        """A wheel goes on from where it was: the robot turns about the other side."""
        with self.lock:
            self.late[told] = time.monotonic() - told
            motor = turns - self.turns.get(node, turns)
            self.turns[node] = turns
            self.rpm[node] = rpm
            side, wheels = self.side(node)
            way = 2 * math.pi * self.machine.true_radii_m[side] * motor / self.machine.gear / wheels
            way += self.random.gauss(0, self.machine.slip * math.sqrt(abs(way)))
            x, y, heading = self.pose
            turn = (1 if side == 1 else -1) * way / self.machine.true_track_m
            middle = heading + turn / 2
            self.pose = (x + way / 2 * math.cos(middle), y + way / 2 * math.sin(middle), heading + turn)

    def lag(self, since):
        """The longest since then [s]: a machine that is busy lets the truth, and with it the fixes, come late."""
        with self.lock:
            return max((lag for told, lag in self.late.items() if told >= since), default=0.0)

    def turn_rate(self):
        """[rad/s], counter-clockwise"""
        machine = self.machine
        mean = [statistics.mean(self.rpm[node] for node in nodes) for nodes in (machine.left, machine.right)]
        rims = [2 * math.pi / 60 * rpm / machine.gear * r for rpm, r in zip(mean, machine.true_radii_m, strict=True)]
        return (rims[1] - rims[0]) / machine.true_track_m

    def place(self, pose):
        with self.lock:
            self.pose = pose


@dataclasses.dataclass(frozen=True)
class GpsError:
    """As sim::GpsParameters."""

    noise_m: float = 0.1  # sd of a fix along each axis
    drift_m: float = 1.0  # sd of what wanders
    drift_s: float = 120.0
    jump_every_s: float = 0.0
    jump_m: float = 3.0
    loss_every_s: float = 0.0
    loss_s: float = 5.0
    period_s: float = 0.1

    def density(self):
        """Of the random walk that the drift looks like for a short time [m²/s]."""
        return 2 * self.drift_m**2 / self.drift_s

    def sd(self):
        """What the best filter leaves on each axis [m]: a walk of density q in noise of density r settles at √(qr)."""
        return (self.density() * self.noise_m**2 * self.period_s) ** 0.25


class FieldReceiver(Receiver):
    """Ten fixes a second of where the robot is, with an error that wanders."""

    DATUM = (63.4178, 10.4018, 55.5)

    def __init__(self, world, gps, seed):
        self.world, self.gps = world, gps
        self.random = random.Random(seed)
        self.error = [self.random.gauss(0, gps.drift_m) for _ in range(2)]
        self.lost_until = 0.0
        self.last = time.monotonic()
        phi = math.radians(self.DATUM[0])
        a, e2 = 6378137.0, 0.00669437999014
        w = math.sqrt(1 - e2 * math.sin(phi) ** 2)
        self.north_m = math.radians(1) * (a * (1 - e2) / w**3 + self.DATUM[2])  # of a degree
        self.east_m = math.radians(1) * (a / w + self.DATUM[2]) * math.cos(phi)
        super().__init__()

    def sentences(self):
        gps, now = self.gps, time.monotonic()
        dt, self.last = now - self.last, now
        kept = math.exp(-dt / gps.drift_s)
        jumps = gps.jump_every_s and self.random.random() < -math.expm1(-dt / gps.jump_every_s)
        for axis in range(2):
            self.error[axis] *= kept
            self.error[axis] += self.random.gauss(0, gps.drift_m * math.sqrt(1 - kept**2))
            self.error[axis] += self.random.gauss(0, gps.jump_m) if jumps else 0
        if gps.loss_every_s and now > self.lost_until and self.random.random() < -math.expm1(-dt / gps.loss_every_s):
            self.lost_until = now + self.random.expovariate(1 / gps.loss_s)
        self.fixed = now >= self.lost_until
        x, y, _ = self.world.pose
        self.longitude = self.DATUM[1] + (x + self.error[0] + self.random.gauss(0, gps.noise_m)) / self.east_m
        self.latitude = self.DATUM[0] + (y + self.error[1] + self.random.gauss(0, gps.noise_m)) / self.north_m
        return super().sentences()


class FieldImu(SingleByte):
    """A 3DM-GX3-25 on the robot: yaw clockwise from north, z down."""

    def __init__(self, link, world, seed):
        self.world = world
        self.random = random.Random(seed)
        super().__init__(link)

    def vectors(self):
        self.yaw = math.pi / 2 - self.world.pose[2] + self.random.gauss(0, 0.01)
        self.rate = [0.0, 0.0, -self.world.turn_rate() + 0.002 + self.random.gauss(0, 0.005)]
        return super().vectors()


class FieldClient(Client):
    def open(self, interface, index=0):
        reply = self.ask(1, 0, 3, struct.pack(">7I", 0, 0, interface, index, 1, 0, 0))
        assert reply[2] == ACK, reply

    @staticmethod
    def text(text):
        data = text.encode() + b"\0"
        return struct.pack(">2I", len(data), len(data)) + data + bytes(-len(data) % 4)

    def power(self):
        """Drives enable only on request; refused until they are up."""
        return self.ask(POSITION2D, 0, POWER_ON, struct.pack(">I", 1))[2] == ACK

    def upload(self, name, points, actions):
        body = self.text(name)
        body += struct.pack(">2I", len(points), len(points)) + b"".join(struct.pack(">3d", *p) for p in points)
        body += struct.pack(">2I", len(actions), len(actions)) + b"".join(struct.pack(">2Id2I", *a) for a in actions)
        assert self.ask(PLANNER, 0, SET_MISSION, body)[2] == ACK

    def run(self, name):
        self.send(PLANNER, 0, 2, RUN, self.text(name))

    def mission(self):
        """(state, point, action, distance [m], reason)"""
        body = self.ask(PLANNER, 0, GET_MISSION)[5]

        def text(at):
            size = struct.unpack_from(">I", body, at)[0]
            return body[at + 8 : at + 8 + size].rstrip(b"\0").decode(), at + 8 + size + -size % 4

        _, at = text(0)
        state, point, _, action, distance = struct.unpack_from(">4Id", body, at)
        return STATES[state], point, action, distance, text(at + 24)[0]

    def arrived(self):
        return struct.unpack(">i", self.ask(POSITION2D, 1, GET_BOOL, self.text("arrived") + bytes(4))[5][-4:])[0] != 0


@contextlib.contextmanager
def hastened():
    """This thread, and all that it starts, before everybody else on the machine, where that is allowed: drives stop by
    themselves when a process stalls for 250 ms."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Robot:
    """All of it: a context."""

    def __init__(self, machine, config, seed=1, gps=None):
        self.machine, self.config, self.seed, self.gps = machine, config, seed, gps
        self.world = World(machine, seed)
        self.outputs = []  # of the left drive, as it was told

    def __enter__(self):
        with contextlib.ExitStack() as stack:
            stack.enter_context(hastened())
            self.folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="regista-field-")))
            bus = self.start_bus(stack)
            keys = {
                "bus": bus,
                "folder": self.folder,
                "rate": "cycle 0.05 feedback 0.05" if KERNEL else "feedback 0.04",
            }
            if self.gps:
                self.receiver = stack.enter_context(FieldReceiver(self.world, self.gps, self.seed + 1))
                keys["gpsd"] = stack.enter_context(Gpsd(free_port(), self.receiver.path)).port
                keys["datum"] = " ".join(map(str, FieldReceiver.DATUM))
                self.imu = stack.enter_context(FieldImu(self.folder / "imu", self.world, self.seed + 2))
            plugins = BIN.parent / "lib/regista"
            options = ["--log-level", "info"]
            self.server = stack.enter_context(
                ServerProcess(self.folder, self.config.format(**keys), plugins, options=options)
            )
            self.client = FieldClient(self.server.port)
            stack.callback(self.client.close)
            self.stack = stack.pop_all()
        return self

    def __exit__(self, *_):
        self.stack.close()

    def start_bus(self, stack):
        if KERNEL:
            bus, arguments = KERNEL, ["--interface", "socketcan", "--channel", KERNEL]
        else:
            command = [sys.executable, PEER / "hub.py", "--port", "0"]
            hub = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            stack.callback(end, hub)
            port = hub.stdout.readline().split()[0]
            bus, arguments = f"socketcand://127.0.0.1:{port}/can0", ["--interface", "socketcand", "--port", port]
        for node in self.machine.left + self.machine.right:
            command = [sys.executable, PEER / "drive.py", *arguments]
            command += ["--node", str(node), "--report", str(REPORT)]
            drive = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            stack.callback(end, drive)
            assert drive.stdout.readline() == "ready\n"
            threading.Thread(target=self.listen, args=[drive], daemon=True).start()
        return bus

    def listen(self, drive):
        for line in drive.stdout:
            if line.startswith("{"):
                told = json.loads(line)
                if "turns" in told:
                    self.world.turned(told["node"], told["turns"], told["rpm"], told["time"])
                elif "counter" in told:
                    self.outputs.append(told["counter"])

    def power(self):
        self.wait_for(self.client.power)

    def wait_for(self, look):
        try:
            wait_for(look, 20)
        except TimeoutError as late:
            raise AssertionError(f"it did not happen:\n{self.server.log()}") from late


def end(process):
    process.kill()
    process.wait()
    process.stdout.close()


# --- Lien 2013 ----------------------------------------------------------------------------------------------------

LIEN = """
driver ( name "can_motor" provides ["actarray:0" "power:0" "dio:0"] bus "{bus}" nodes [5 6] gear 40
         wheel_speed 1500 wheel_accel 3000 wheel_decel 3000 quick_stop 3000 relays ["5 2010:00 0"] {rate} )
driver ( name "differential" provides ["position2d:0"] requires ["actarray:0"] rate 50
         wheel_radius 0.15 track 0.6 accel 3 turn_accel 360 )
driver ( name "gps" provides ["gps:0" "localize:0"] port {gpsd} datum [{datum}] sd 0.1 )
driver ( name "imu" provides ["imu:0"] port "{folder}/imu" protocol "single_byte" )
driver ( name "localizer" provides ["position2d:1" "localize:1"] requires ["position2d:0" "imu:0" "localize:0"] rate 50
         imu_heading yes heading_sd 1.15 slip_density 0.0167 accel_density 3 turn_density 10 )
driver ( name "waypoint" provides ["planner:0"] requires ["position2d:0" "position2d:1" "dio:0"] relays 1 rate 50
         relay_feedback yes park {{park}} leave {{leave}} estimates 5 {{keys}} )
"""
PARK, LEAVE = 0.07, 0.14  # [m]
SQUARE = [(10, 0, math.pi / 2), (10, 10, math.pi), (0, 10, -math.pi / 2), (0, 0, 0)]
ROWS = [(8, 0, 0), (16, 0, 0), (24, 4, math.pi / 2), (16, 8, math.pi), (8, 8, math.pi), (0, 8, math.pi)]
FIELD_GPS = GpsError()
ROUGH_GPS = GpsError(jump_every_s=60, loss_every_s=60)


@dataclasses.dataclass
class Stop:
    """How far off the robot was when it stood at a point [m]."""

    estimate_m: float  # it believed
    truth_m: float
    beyond_gps_m: float  # the truth, as the GPS shows it
    lag_s: float  # see World.lag, of the last ten seconds


@dataclasses.dataclass
class Drive:
    stops: list
    time_s: float
    outputs: list
    failures: list
    server_log: str


def drive_lien(points, gps, keys, seed=1, limit_s=300.0):
    """Each point switches a relay on, asks when it stands there, and switches it off. After a failure it goes on."""
    config = LIEN.replace("{{park}}", str(PARK)).replace("{{leave}}", str(LEAVE)).replace("{{keys}}", keys)
    with Robot(FIELD_ROBOT, config, seed, gps) as robot:
        client = robot.client
        client.open(PLANNER)
        client.open(POSITION2D)
        robot.power()
        client.open(POSITION2D, 1)
        robot.wait_for(lambda: client.receive()[:4] == (POSITION2D, 1, DATA, 1))
        work = [(RELAY, 1), (ASK, 0), (RELAY, 0)]
        client.upload("lien", points, [(i, act, 0, 0, on) for i in range(len(points)) for act, on in work])
        begun = time.monotonic()
        client.run("lien")
        stops, failures = [], []
        while time.monotonic() - begun < limit_s:
            time.sleep(0.05)
            state, point, action, distance, reason = client.mission()
            if state == "failed":
                failures.append(f"point {point}: {reason}")
                robot.power()
                assert client.ask(PLANNER, 0, 2, struct.pack(">I", 1))[2] == ACK
            if state == "finished":
                break
            if state != "asking" or len(stops) != point:
                continue
            x, y, _ = robot.world.pose
            gx, gy, _ = points[point]
            ex, ey = robot.receiver.error
            robot.wait_for(lambda: robot.outputs[-1:] == [1])
            lag = robot.world.lag(time.monotonic() - 10)
            stops.append(Stop(distance, math.hypot(x - gx, y - gy), math.hypot(x + ex - gx, y + ey - gy), lag))
            assert client.ask(PLANNER, 0, GO_ON, struct.pack(">2I", point, action))[2] == ACK
        return Drive(stops, time.monotonic() - begun, robot.outputs, failures, robot.server.log())


# --- Kvalheim, Isaksen, Næss 2017 -----------------------------------------------------------------------------------

OSLO = """
driver ( name "can_motor" provides ["actarray:0" "power:0"] bus "{bus}" nodes [5 6 7 8] gear 9
         wheel_speed 4500 wheel_accel 20000 wheel_decel 20000 quick_stop 20000 {rate} )
driver ( name "differential" provides ["position2d:0"] requires ["actarray:0"] skid_steer yes rate 50
         wheel_radius 0.035 track 0.357 accel 1000 turn_accel 100000 )
driver ( name "posture" provides ["position2d:1"] requires ["position2d:0"] rate 50
         turn_tolerance 2.86 turn_speed 114.6 ramp 3 turn_ramp 1146 {{gains}} )
"""
GAINS = {
    "2/4/1.3": "k1 2 k2 4 k3 1.3 accel 1000 turn_accel 100000",
    "1/6/7": "k1 1 k2 6 k3 7 accel 1000 turn_accel 100000",
    "ours": "k1 4 k2 8 k3 2 accel 3 turn_accel 1146",
}
STARTS = [(-1.5, -1, 0), (-1, 1, math.pi / 2), (1, 1, math.pi), (0, 1.2, -math.pi / 2)]


@dataclasses.dataclass
class Parking:
    time_s: float
    truth_m: float


def park_oslo(gains, seed=1):
    """From each of the figures' four poses to the origin, by odometry."""
    with Robot(ROVER, OSLO.replace("{{gains}}", GAINS[gains]), seed) as robot:
        client = robot.client
        client.open(POSITION2D)
        robot.power()
        client.open(POSITION2D, 1)
        found = []
        for start in STARTS:
            robot.world.place(start)
            assert client.ask(POSITION2D, 0, SET_ODOM, struct.pack(">3d", *start))[2] == ACK
            time.sleep(0.7)  # the last destination is given up: who goes on has to pause for a lease
            begun = time.monotonic()
            client.send(POSITION2D, 1, 2, 2, struct.pack(">6dI", 0, 0, 0, 0, 0, 0, 1))
            if found:
                robot.wait_for(lambda: not client.arrived())
            robot.wait_for(client.arrived)
            took = time.monotonic() - begun
            found.append(Parking(took, math.hypot(*robot.world.pose[:2])))
        return found


# --- The table ------------------------------------------------------------------------------------------------------


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    print("| | quantity | unit | mean | worst |\n|---|---|---|--:|--:|")

    def row(name, quantity, unit, values):
        print(f"| {name} | {quantity} | {unit} | {statistics.mean(values):.3g} | {max(values):.3g} |", flush=True)

    published = "speed 0.8 turn_speed 45.8"
    for name, points, gps in (("L scenario 1", SQUARE, FIELD_GPS), ("L scenario 2", ROWS, ROUGH_GPS)):
        drives = []
        for run in range(1, runs + 1):
            drives.append(drive_lien(points, gps, published, seed=10 * run))
            print(
                name, drives[-1].stops, drives[-1].failures, f"{drives[-1].time_s:.0f} s", file=sys.stderr, flush=True
            )
        stops = list(itertools.chain.from_iterable(drive.stops for drive in drives))
        row(name, "what the simulated truth came late by", "s", [stop.lag_s for stop in stops])
        row(name, "points not worked at", "1", [len(points) - len(drive.stops) for drive in drives])
        row(name, "time", "s", [drive.time_s for drive in drives])
        row(name, "estimate to goal", "m", [stop.estimate_m for stop in stops])
        row(name, "truth to goal", "m", [stop.truth_m for stop in stops])
        row(name, "truth to goal beyond the GPS's own error", "m", [stop.beyond_gps_m for stop in stops])
    for gains in GAINS:
        parked = list(itertools.chain.from_iterable(park_oslo(gains, seed=run) for run in range(1, runs + 1)))
        row(f"O 3-6, {gains}", "time to ±0.05", "s", [p.time_s for p in parked])
        row(f"O 3-6, {gains}", "true distance from the goal then", "m", [p.truth_m for p in parked])


if __name__ == "__main__":
    main()
