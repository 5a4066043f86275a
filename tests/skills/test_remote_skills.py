# SPDX-License-Identifier: Apache-2.0
"""Skills on one server that stand on the devices of another: two real processes, and what happens when one dies."""

import math
import struct
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))
from regista_process import ACK, BIN, DATA, POSITION2D, Client, ServerProcess, wait_for

DRIVERS = BIN.parent / "lib/regista"
PLANNER, LOCALIZE = 44, 25
SET_MISSION, GET_MISSION, GET_TEXT, RUN = 100, 101, 250, 100
DRIVING, FAILED, FINISHED = 2, 6, 7

pytestmark = pytest.mark.skipif(not (DRIVERS / "simulated_gps.so").exists(), reason="built without GeographicLib")

# The robot: wheels, compass, GPS.
ROBOT = """
driver ( name "simulated_base" provides ["position2d:0" "truth:::position2d:1"] rate 100 holonomic no
         motor_speed 2 motor_accel 3 drift 0.02 turn_drift 0.02 )
driver ( name "simulated_gps" provides ["gps:0" "localize:0"] requires ["position2d:1"] datum [63.4178 10.4018 46]
         noise 0.05 drift 0.05 )
driver ( name "simulated_imu" provides ["imu:0"] requires ["position2d:1"] rate 50 )
"""
# The brain, elsewhere: all that it stands on is the robot's.
BRAIN = """
driver ( name "localizer" provides ["position2d:0" "localize:1"]
         requires ["{at}:position2d:0" "{at}:imu:0" "{at}:localize:0"]
         rate 50 imu_heading yes heading_sd 6 fix_sd 0.1 slip_density 0.002 )
driver ( name "waypoint" provides ["planner:0"] requires ["{at}:position2d:0" "position2d:0"]
         rate 50 speed 1.5 park 0.25 beta 0.05 )
driver ( name "posture" provides ["position2d:2"] requires ["{at}:position2d:0" "position2d:0"] rate 50 )
"""


class Listener(Client):
    def open(self, interface, index=0):
        assert self.ask(1, 0, 3, struct.pack(">7I", 0, 0, interface, index, 1, 0, 0))[2] == ACK

    def next(self, interface, index=0, true=lambda *_: True):
        """The next (x, y, heading, vx, vy, w) for which it is true."""

        def look():
            message = self.receive()
            if message[:4] != (interface, index, DATA, 1):
                return None
            numbers = struct.unpack_from(">6d", message[5])
            return numbers if true(*numbers) else None

        return wait_for(look, 30)

    @staticmethod
    def text(text):
        data = text.encode() + b"\0"
        return struct.pack(">2I", len(data), len(data)) + data + bytes(-len(data) % 4)

    def property(self, interface, index, key):
        key = self.text(key)
        reply = self.ask(interface, index, GET_TEXT, key + struct.pack(">2I", 0, 0))
        assert reply[2] == ACK
        return reply[5][len(key) + 8 :].rstrip(b"\0").decode()

    def run(self, points):
        body = self.text("there") + struct.pack(">2I", len(points), len(points))
        body += b"".join(struct.pack(">3d", *point) for point in points) + struct.pack(">2I", 0, 0)
        assert self.ask(PLANNER, 0, SET_MISSION, body)[2] == ACK
        self.send(PLANNER, 0, 2, RUN, self.text("there"))

    def mission(self):
        """(state, reason)"""
        body = self.ask(PLANNER, 0, GET_MISSION)[5]
        at = 8 + struct.unpack_from(">I", body)[0]
        at += -at % 4
        reason = body[at + 32 : at + 32 + struct.unpack_from(">I", body, at + 24)[0]]
        return struct.unpack_from(">I", body, at)[0], reason.rstrip(b"\0").decode()


class Pair:
    """A robot, its brain, and a client of each."""

    def __init__(self, folder):
        for name in ("robot", "brain"):
            (folder / name).mkdir()
        self.robot = ServerProcess(folder / "robot", ROBOT, DRIVERS, options=["--log-level", "info"])
        at = f"127.0.0.1:{self.robot.port}"
        self.brain = ServerProcess(folder / "brain", BRAIN.format(at=at), DRIVERS, options=["--log-level", "info"])
        self.client = Listener(self.brain.port, timeout=30)
        self.client.open(POSITION2D, 0)
        self.client.open(PLANNER)
        self.client.open(POSITION2D, 2)
        self.client.next(POSITION2D)  # it knows where it is
        self.truth = Listener(self.robot.port, timeout=30)
        self.truth.open(POSITION2D, 1)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for client in (self.client, self.truth):
            client.close()
        for server in (self.brain, self.robot):
            server.__exit__()

    def reaches(self, state):
        try:
            return wait_for(lambda: self.client.mission() if self.client.mission()[0] == state else None, 30)
        except TimeoutError as late:
            raise AssertionError(f"{self.client.mission()}\n{self.brain.log()}\n{self.robot.log()}") from late

    def fast(self):
        """Until the robot really drives."""
        self.truth.next(POSITION2D, 1, lambda x, y, heading, vx, *_: vx > 0.5)


@pytest.fixture
def pair(tmp_path):
    with Pair(tmp_path) as pair:
        yield pair


def test_localizer_and_waypoint_drive_the_base_of_another_server(pair):
    pair.client.run([(3, 0, 0), (4, 1, 1.57)])
    pair.reaches(FINISHED)
    fresh = Listener(pair.robot.port)
    fresh.open(POSITION2D, 1)
    x, y, *_ = fresh.next(POSITION2D, 1)
    fresh.close()
    assert math.hypot(x - 4, y - 1) < 0.25 + 4 * 0.1  # parked, and what the fixes are off by
    assert pair.client.property(POSITION2D, 0, "status") == "tracking"
    assert pair.client.property(POSITION2D, 0, "explain").startswith("tracking: position sd ")


def test_posture_brings_the_base_of_another_server_to_a_pose(pair):
    pair.client.send(POSITION2D, 2, 2, 2, struct.pack(">6dI", 1.5, 0.5, 0, 0, 0, 0, 1))
    _, _, heading, *_ = pair.truth.next(
        POSITION2D, 1, lambda x, y, heading, vx, *_: abs(vx) < 0.01 and math.hypot(x - 1.5, y - 0.5) < 0.4
    )
    assert abs(heading) < 0.5


def test_everything_stops_with_the_reason_when_the_robots_server_dies(pair):
    pair.client.run([(50, 0, 0)])
    pair.fast()
    pair.robot.process.kill()
    _, reason = pair.reaches(FAILED)
    assert reason in (
        "no position that can be believed",
        "the base does not do what it is told: blocked, stopped, without power, or driven by somebody else",
    )
    wait_for(lambda: "failed: " in pair.brain.log())
    assert f"127.0.0.1:{pair.robot.port}" in pair.brain.log()
    assert pair.client.property(POSITION2D, 0, "status") in ("no wheels", "lost"), pair.client.property(
        POSITION2D, 0, "explain"
    )


def test_posture_gives_up_when_the_robots_server_dies(pair):
    pair.client.send(POSITION2D, 2, 2, 2, struct.pack(">6dI", 50, 0, 0, 0, 0, 0, 1))
    pair.fast()
    pair.robot.process.kill()
    wait_for(lambda: "position2d:2 stopped: " in pair.brain.log())
    line = next(line for line in pair.brain.log().splitlines() if "position2d:2 stopped: " in line)
    assert "destination given up" in line, line


def test_the_robot_stops_by_itself_when_its_brain_dies(pair):
    pair.client.run([(50, 0, 0)])
    pair.fast()
    pair.brain.process.kill()
    pair.truth.next(POSITION2D, 1, lambda x, y, heading, vx, *_: abs(vx) < 0.01)
    wait_for(lambda: "position2d:0 stopped: " in pair.robot.log())
    assert 'stopped: owner "waypoint" disconnected' in pair.robot.log()
