# SPDX-License-Identifier: Apache-2.0
"""regista-camera as it ships: from pictures of boards and a field to the robots' servers, by multicast on lo."""

import contextlib
import json
import math
import socket
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "vision"))
from league import BIN, VISION_GROUP, Bridge, Robots, free_udp_port, unpack, wait_for

CAMERA = BIN / "regista-camera"
pytestmark = pytest.mark.skipif(not CAMERA.exists(), reason="built without REGISTA_CAMERA")


def camera(*arguments, code=0):
    done = subprocess.run([CAMERA, *arguments], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """What somebody who sets up a camera has, and the truth: see render_field.cpp."""
    folder = tmp_path_factory.mktemp("field")
    subprocess.run([BIN / "render_field", folder], check=True, timeout=300)
    return folder


@pytest.fixture(scope="module")
def calibrated(field):
    file = field / "camera.cfg"
    camera("calibrate", "lens", file, field / "boards", "--board", "9x6", "--square", "0.04")
    report = camera("calibrate", "field", file, field / "field.png", "--points", field / "points.txt")
    place = [float(word) for word in report.rpartition("(")[0].rpartition("(")[2].split(")")[0].split(",")]
    assert place == pytest.approx([0.1, 0.05, 4], abs=0.01), report
    report = camera("calibrate", "colours", file, field / "robots.png", "--samples", field / "samples.txt")
    assert "warning" not in report, report
    return file


def truth(field):
    """{(picture, team, id): (x, y, heading)}"""
    lines = (line.split() for line in (field / "truth.txt").read_text().splitlines())
    return {(int(i), team, int(number)): tuple(map(float, pose)) for i, team, number, *pose in lines}


@contextlib.contextmanager
def hearing(group, port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        ear.bind((group, port))
        ear.setsockopt(
            socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        )
        ear.setblocking(False)

        def take():
            packets = []
            with contextlib.suppress(BlockingIOError):
                while True:
                    packets.append(ear.recv(65536))
            return packets

        yield take


def test_a_camera_is_calibrated_and_sees_each_robot_where_it_is(field, calibrated):
    pictures = [json.loads(line) for line in camera("detect", field / "run", calibrated).splitlines()]
    true = truth(field)
    seen = {(p["frame"], r["team"], r["id"]): (r["x"], r["y"], r["heading"]) for p in pictures for r in p["robots"]}
    assert seen.keys() == true.keys()
    off = [math.dist(seen[key][:2], true[key][:2]) for key in true]
    turned = [abs(math.remainder(seen[key][2] - true[key][2], math.tau)) for key in true]
    print(f"{1e3 * sum(off) / len(off):.2f} mm, at worst {1e3 * max(off):.2f}; at worst {1e3 * max(turned):.2f} mrad")
    assert max(off) < 0.006 and max(turned) < 0.02
    for number, picture in enumerate(pictures):
        (ball,) = picture["balls"]
        t = number / 30
        assert math.dist((ball["x"], ball["y"]), (1.5 - 0.8 * t, -0.3 + 0.5 * t)) < 0.006


def test_packets_are_those_of_the_league(field, calibrated):
    port = free_udp_port()
    with hearing(VISION_GROUP, port) as take:
        camera("run", field / "run", calibrated, "--interface", "lo", "--port", str(port), "--rate", "200")
        packets = [dict(unpack(packet)) for packet in take()]
    geometry = [packet[2] for packet in packets if 2 in packet]
    frames = [dict(unpack(packet[1])) for packet in packets if 1 in packet]
    assert len(geometry) >= 1 and len(frames) == 60
    assert [frame[1] for frame in frames] == list(range(60))
    robot = dict(unpack(frames[0][6]))  # yellow
    assert robot[2] == 3 and robot[3] == pytest.approx(1000, abs=6) and robot[4] == pytest.approx(0, abs=6)
    assert robot[5] == pytest.approx(math.pi / 2, abs=0.02) and robot[8] == pytest.approx(150)

    # Through the model as others read it, the robot's place gives its pixel: project by the league's formulas.
    model = dict(unpack(dict(unpack(geometry[0]))[2]))
    focal, px, py, k = (model[number] for number in (2, 3, 4, 5))
    q, t = [model[number] for number in (6, 7, 8, 9)], [model[number] for number in (10, 11, 12)]

    def rotate(q, v):
        x, y, z, w = q
        u = [y * v[2] - z * v[1] + w * v[0], z * v[0] - x * v[2] + w * v[1], x * v[1] - y * v[0] + w * v[2]]
        return [
            v[0] + 2 * (y * u[2] - z * u[1]),
            v[1] + 2 * (z * u[0] - x * u[2]),
            v[2] + 2 * (x * u[1] - y * u[0]),
        ]

    x, y, z = (a + b for a, b in zip(rotate(q, [robot[3], robot[4], 150]), t, strict=True))
    straight = math.hypot(x, y) / z
    bent = straight
    for _ in range(50):  # r (1 + k r²) = straight
        bent = straight / (1 + k * bent * bent)
    assert px + focal * bent / straight * x / z == pytest.approx(robot[6], abs=0.3)
    assert py + focal * bent / straight * y / z == pytest.approx(robot[7], abs=0.3)
    assert (model[13], model[14]) == pytest.approx((100, 50), abs=15) and model[15] == pytest.approx(4000, abs=15)
    assert (model[16], model[17]) == (780, 580)


def test_the_bridge_tells_the_robots_what_the_camera_sees(tmp_path, field, calibrated):
    names = [("yellow", 3), ("blue", 12)]
    with Robots(len(names)) as robots:
        addresses = [(*name, port) for name, port in zip(names, robots.ports, strict=True)]
        with Bridge(tmp_path, addresses) as bridge:
            bridge.connected()
            camera(
                "run", field / "run", calibrated, "--interface", "lo", "--port", str(bridge.vision_port), "--rate", "30"
            )
            wait_for(lambda: all(robots.poses))
            status = bridge.status()
    assert [c["id"] for c in status["cameras"]] == [0]
    drives, rests = robots.poses
    assert len(drives) > 10 and len(rests) > 10  # a loaded machine skips some
    assert all(abs(math.hypot(x, y) - 1) < 0.02 for _, x, y, _, _ in drives)
    _, x, y, heading, _ = rests[-1]
    assert (x, y, heading) == pytest.approx((-1.5, -1.2, 0.5), abs=0.006)


def test_a_run_is_drawn_in_one_picture(tmp_path, field, calibrated):
    picture = tmp_path / "run.png"
    camera("overlay", field / "run", calibrated, "--rate", "30", "--every", "0.4", "--output", picture)
    # The same picture, seen again: the robot at each of the intervals, so several times the same.
    (line,) = camera("detect", picture, calibrated).splitlines()
    robots = json.loads(line)["robots"]
    drives = [r for r in robots if (r["team"], r["id"]) == ("yellow", 3)]
    assert len(drives) == 5
    for robot, beat in zip(sorted(drives, key=lambda r: math.atan2(r["y"], r["x"]) % math.tau), range(5), strict=True):
        a = 1.5 * 0.4 * beat
        assert (robot["x"], robot["y"]) == pytest.approx((math.cos(a), math.sin(a)), abs=0.015)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["detect", "nothing", "{}"], 65, "neither a camera nor a file"),
        (["detect", "{field}/run", "missing.cfg"], 78, "missing.cfg"),
        (["run", "{field}/run", "{}", "--interface", "nonet0"], 71, "nonet0"),
        (["calibrate", "lens", "new.cfg", "{field}/field.png", "--square", "0.04"], 65, "at least 3"),
        (["calibrate", "lens", "new.cfg", "{field}/boards", "--square", "0.04", "--board", "9"], 64, "--board"),
        (["calibrate", "field", "{}", "{field}/field.png"], 65, "no display"),
        (["calibrate", "field", "{}", "{field}/boards/0.png", "--points", "{field}/samples.txt"], 65, "samples.txt:1"),
    ],
)
def test_errors_say_what_is_wrong(arguments, code, words, field, calibrated, monkeypatch, tmp_path):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.chdir(tmp_path)
    filled = [a.replace("{field}", str(field)).replace("{}", str(calibrated)) for a in arguments]
    assert words in camera(*filled, code=code)


def test_a_wrong_point_is_named_and_nothing_is_written(tmp_path, field, calibrated):
    before = calibrated.read_text()
    points = tmp_path / "points.txt"
    lines = (field / "points.txt").read_text().splitlines()
    x, y, *pixel = lines[5].split()
    points.write_text("\n".join([*lines[:5], f"{x} {-float(y)} {' '.join(pixel)}", *lines[6:]]))
    assert "nothing is written" in camera(
        "calibrate", "field", calibrated, field / "field.png", "--points", points, code=65
    )
    assert calibrated.read_text() == before
