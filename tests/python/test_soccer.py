# SPDX-License-Identifier: Apache-2.0
"""Teams on the simulated field of examples/soccer/field.sh."""

import itertools
import math
import os
import socket
import struct
import subprocess
import time
from pathlib import Path

import pytest
from conftest import BIN, ROOT

pytest.importorskip("regista._soccer")
from regista.soccer import Team

pytestmark = pytest.mark.skipif(not (BIN / "regista-field-sim").exists(), reason="built without REGISTA_VISION")
PORT = 20000 + 64 * (os.getpid() % 150)  # below what the kernel gives to clients
UDP = PORT + 40


@pytest.fixture(scope="module")
def field():
    """Four robots of yellow, one of blue; the folder of team.cfg."""
    script = ROOT / "examples/soccer/field.sh"
    command = [script, "--yellow", "4", "--blue", "1", "--port", str(PORT), "--udp", str(UDP), "--"]
    process = subprocess.Popen(
        [*command, "sh", "-c", "pwd && read end"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "REGISTA_BIN": str(BIN)},
    )
    yield Path(process.stdout.readline().strip())
    process.terminate()
    process.wait()
    process.stdin.close()
    process.stdout.close()


@pytest.fixture
def team(field):
    with Team(field / "team.cfg", "yellow", speed_mps=1.2) as yellow:
        read_until(yellow, lambda: len(yellow.field()) == 5)
        yield yellow


def read_until(team, look, timeout=20.0):
    end = time.monotonic() + timeout
    while not look():
        team.read(timeout=0.05)
        assert time.monotonic() < end, [(robot, robot.pose, robot.stopped_because) for robot in team]


def test_robots_change_places_and_none_touches(team):
    closest = math.inf

    def there():
        nonlocal closest
        places = [(robot.x, robot.y) for robot in team.field()]
        closest = min([closest, *itertools.starmap(math.dist, itertools.combinations(places, 2))])
        return all(robot.is_at(x, y, distance_m=0.1, heading_rad=0.3) for robot, (x, y) in goals.items())

    for side in (1, -1):
        angles = {robot: side * math.pi / 2 + math.pi / 2 * robot.id for robot in team}
        goals = {robot: (-1.5 + 0.8 * math.cos(a), 0.8 * math.sin(a)) for robot, a in angles.items()}
        for robot, (x, y) in goals.items():
            robot.drive_to(x, y)
        read_until(team, there)
    print(f"closest {1e3 * closest:.0f} mm from middle to middle")
    assert closest > 0.17, "180 mm is a touch; the cameras are a few millimetres off"


def test_a_robot_that_drives_itself_reaches_its_destination(team):
    team[3].go_to(-2.5, 1.5, 1.0)
    read_until(team, lambda: team[3].is_at(-2.5, 1.5, 1.0))


def test_the_ball_and_opponents_are_seen(team):
    assert team.ball is not None and math.hypot(team.ball.x, team.ball.y) < 0.1
    blue = team.seen("blue", 0)
    assert (blue.x, blue.y) == pytest.approx((1.5, 0), abs=0.05)
    assert team.seen("blue", 7) is None


def test_after_halt_the_team_goes_on(team):
    referee = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    referee.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))

    def command(number, counter):
        packet = struct.pack("12B", 1 << 3, 0, 2 << 3, 0, 4 << 3, number, 5 << 3, counter, 6 << 3, 0, 9 << 3, 0)[:10]
        referee.sendto(packet, ("224.5.23.1", UDP + 2))

    def speed():
        return math.hypot(team[0].velocity.x, team[0].velocity.y)

    x = -2.5 if team[0].pose.x > -1.5 else -0.5
    team[0].drive_to(x, -2)
    read_until(team, lambda: speed() > 0.3)
    command(0, 1)
    read_until(team, lambda: speed() < 0.02)
    halted = team[0].pose
    read_until(team, lambda: "asked for a stop" in team[0].stopped_because)
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        team.read(timeout=0.05)
    assert math.dist((halted.x, halted.y), (team[0].pose.x, team[0].pose.y)) < 0.05
    command(3, 2)
    read_until(team, lambda: team[0].is_at(x, -2))
    referee.close()


def test_errors_are_told_in_words(field, tmp_path):
    with pytest.raises(ValueError, match="yellow"):
        Team(field / "team.cfg", "red")
    with pytest.raises(ValueError, match="above 0"):
        Team(field / "team.cfg", "yellow", gain=-1)
    with Team(field / "team.cfg", "blue") as blue:
        with pytest.raises(KeyError):
            blue[5]
        with pytest.raises(ValueError, match="finite"):
            blue[0].drive_to(math.nan, 0)
    with pytest.raises(ValueError, match="closed"):
        blue.read(timeout=0)
    wrong = tmp_path / "team.cfg"
    wrong.write_text('robot ( team "yellow" id 99 host "localhost" )')
    with pytest.raises(RuntimeError, match=r"team\.cfg:1"):
        Team(wrong, "yellow")
