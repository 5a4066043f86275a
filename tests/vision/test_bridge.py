# SPDX-License-Identifier: Apache-2.0
"""regista-vision-bridge as it ships: real multicast on lo in, TCP to robots' servers out."""

import contextlib
import itertools
import math
import socket
import subprocess
import sys
import time
from random import Random

import pytest
from league import (
    BLUE,
    BRIDGE,
    DATA,
    YELLOW,
    Bridge,
    Robots,
    detection,
    deviation,
    records,
    referee,
    tracked,
    unpack,
    wait_for,
)

sys.path.append(str(DATA.parent / "faults"))
from regista_process import Client, Server

pytestmark = pytest.mark.skipif(not BRIDGE.exists(), reason="built without REGISTA_VISION")
NOISE = 0.3  # s that a loaded machine may add


def pace(begin, period):
    """Count beats, at their times."""
    beat = 0
    while True:
        time.sleep(max(0.0, begin + beat * period - time.monotonic()))
        yield beat
        beat += 1


def play(bridge, seconds, robots, rate=60, clock=0.0, balls=()):
    """One camera that sees robots stand."""
    for beat in pace(time.monotonic(), 1 / rate):
        if beat > seconds * rate:
            return
        bridge.vision.send(detection(0, beat, clock + beat / rate, robots, balls))


def test_recorded_vision_reaches_every_robot(tmp_path):
    """Three seconds of a simulator with the noise, loss and badly aligned cameras of a real field."""
    names = [(team, robot) for team in ("yellow", "blue") for robot in range(11)]
    recording = records(DATA / "vision-22robots.log")
    with Robots(len(names)) as robots:
        addresses = [(*name, port) for name, port in zip(names, robots.ports, strict=True)]
        with Bridge(tmp_path, addresses, keys="delay 0.025") as bridge:
            bridge.connected()
            cpu = bridge.cpu()
            begin = time.monotonic() - recording[0][0]
            for stamp, packet in recording:
                time.sleep(max(0.0, begin + stamp - time.monotonic()))
                bridge.vision.send(packet)
            time.sleep(0.1)
            cpu = (bridge.cpu() - cpu) / (recording[-1][0] - recording[0][0])
            status = bridge.status()
            prometheus = bridge.get("/metrics")
    worst_m = worst_rad = 0.0
    ages = []
    for (team, robot), poses in zip(names, robots.poses, strict=True):
        assert len(poses) > 150, f"{team} {robot}"
        for before, after in itertools.pairwise(poses):
            assert abs(after[1] - before[1]) < 0.15 and abs(after[2] - before[2]) < 0.05, f"{team} {robot} jumps"
        ages += [pose[4] for pose in poses]
        settled = [pose for pose in poses if pose[0] - poses[0][0] > 0.5]
        assert abs(poses[-1][2] - (1.5 if team == "yellow" else -1.5)) < 0.01
        if (team, robot) == ("blue", 10):  # drives
            continue
        assert abs(poses[-1][1] - (0.5 * robot - 2.5)) < 0.03, f"{team} {robot}"
        worst_m = max(worst_m, *(deviation([pose[i] for pose in settled]) for i in (1, 2)))
        worst_rad = max(worst_rad, deviation([pose[3] for pose in settled]))
    ages.sort()
    print(f"at rest {1e3 * worst_m:.2f} mm, {1e3 * worst_rad:.2f} mrad; {100 * cpu:.1f} % of a processor;")
    print(f"age p50 {1e3 * ages[len(ages) // 2]:.1f} ms, p99 {1e3 * ages[len(ages) * 99 // 100]:.1f} ms")
    print("latency in us:", status["robots"][0]["latency_us"])
    assert worst_m < 0.001 and worst_rad < 0.005
    # 10 ms that the simulator says it took, 25 ms that the configuration adds
    assert 0.034 < ages[len(ages) // 2] < 0.045 + NOISE
    assert [round(camera["overlap_mm"]) for camera in status["cameras"]] == [40, 40]
    assert status["cameras"][0]["interfaces"] == ["lo"]
    assert status["undecodable"] == 0
    assert 'regista_vision_cameras_rate_hz{id="0"}' in prometheus
    assert 'regista_vision_robots_latency_us_p99{id="yellow 3"}' in prometheus


def turn_about(bridge, robots, count, seconds, hidden, rate=3.0):
    """Robots that turn to and fro, at 0.8 Hz and `rate` [rad/s] at most, and tell so; a camera with the noise of a real
    one, 8 ms of work for a frame, and `hidden` [s] that it does not tell."""
    random = Random(1)
    beat_w = 2 * math.pi * 0.8
    begin = time.monotonic()
    for beat in pace(begin, 1 / 75):
        t = time.monotonic()
        if t - begin > seconds:
            return
        for robot in range(count):
            robots.tell_turn(robot, rate * math.cos(beat_w * t + robot))
        seen = [
            (
                YELLOW,
                robot,
                robot + random.gauss(0, 0.002),
                0,
                rate / beat_w * math.sin(beat_w * (t - 0.008 - hidden) + robot) + random.gauss(0, 0.01),
            )
            for robot in range(count)
            if random.random() > 0.02
        ]
        bridge.vision.send(detection(0, beat, t - 0.008, seen, t_sent=t))


def test_the_delay_that_no_timestamp_shows_is_learnt(tmp_path):
    hidden, count = 0.033, 4
    with Robots(count) as robots:
        addresses = [("yellow", robot, port) for robot, port in enumerate(robots.ports)]
        with Bridge(tmp_path, addresses) as bridge:
            bridge.connected()
            turn_about(bridge, robots, count, 2, hidden, rate=0.0)
            assert bridge.status()["delay"] == {"ms": 0, "told": False, "learnt": False}, "nothing moves, nothing shows"
            turn_about(bridge, robots, count, 6, hidden)
            wait_for(lambda: bridge.status()["delay"]["learnt"])
            assert "vision takes " in bridge.log()
            assert "regista_vision_delay_ms" in bridge.get("/metrics")
            turn_about(bridge, robots, count, 1, hidden)  # it comes into force little by little
            learnt = bridge.status()["delay"]
            robots.poses[0].clear()
            turn_about(bridge, robots, count, 0.5, hidden)
            ages = sorted(pose[4] for pose in robots.poses[0])
        print(f"{1e3 * hidden} ms that no timestamp shows:", learnt)
        assert abs(learnt["ms"] - 1e3 * hidden) < 3
        assert 0.037 < ages[len(ages) // 2] < 0.045 + NOISE
        with Bridge(tmp_path, addresses, keys="delay 0.005") as bridge:
            bridge.connected()
            turn_about(bridge, robots, count, 3, hidden)
            assert bridge.status()["delay"] == {"ms": 5, "told": True}


def test_robots_are_told_through_a_real_server(tmp_path):
    folder = tmp_path / "server"
    folder.mkdir()
    # Far beyond any limit on velocities: a device in `sensors` has none.
    seen = [(BLUE, 3, 4.25, -2.5, 0.75)]
    with Server(folder, keys='sensors ["position2d:0"]') as server:
        with Bridge(tmp_path, [("blue", 3, server.port, 0)]) as bridge:
            bridge.connected()
            play(bridge, 0.5, seen)
            wait_for(lambda: server.events("velocity"))
        _, _, numbers = server.events("velocity")[-1]
        assert numbers == pytest.approx([4.25, -2.5, 0.75], abs=1e-3)
        assert not [e for e in server.events("velocity") if not any(e[2])], "no stop is made up"


def test_halt_stops_robots_whoever_drives_them(tmp_path):
    folder = tmp_path / "server"
    folder.mkdir()
    with Server(folder, keys="lease 0.5") as server, contextlib.closing(Client(server.port)) as driver:
        driver.open()
        driver.pull()
        with Bridge(tmp_path, [("blue", 3, server.port, 0)]) as bridge:
            bridge.connected()
            driver.velocity(0.5)
            server.driven(0.5)
            halted = time.monotonic()
            bridge.referee.send(referee(0))
            assert server.rested(halted) - halted < 0.1 + NOISE
            # A program that does not care is stopped again and again, without another packet of the referee.
            for _ in pace(time.monotonic(), 0.02):
                driver.velocity(0.25)
                if time.monotonic() > halted + 1:
                    break
            time.sleep(0.1 + NOISE)
            _, name, numbers = server.events("velocity", "halt")[-1]
            assert name == "halt" or not any(numbers)
            bridge.referee.send(referee(3, 2))
            wait_for(lambda: not bridge.status()["referee"]["halt"])
            time.sleep(0.5 + NOISE)  # who was stopped must pause for a lease: docs/policies.md
            free = time.monotonic()
            driver.velocity(0.75)
            server.driven(0.75, since=free)


def test_a_device_that_opens_slowly_withholds_no_halt(tmp_path):
    with Robots(1) as robots:
        robots.opening.add(0)
        with Bridge(tmp_path, [("yellow", 0, robots.ports[0])]) as bridge:
            wait_for(lambda: robots.asked[0] == [1, 0])
            halted = time.monotonic()
            bridge.referee.send(referee(0))
            wait_for(lambda: robots.stops[0] > 2)
            assert time.monotonic() - halted < 0.15 + NOISE
            # A robot that connects during the HALT is not asked for what may keep it busy.
            robots.hang_up()
            wait_for(lambda: bridge.status()["robots"][0]["connects"] == 2)
            stops = robots.stops[0]
            time.sleep(1)
            assert robots.stops[0] - stops > 10
            assert robots.asked[0] == [1, 0, 1]
            # Afterwards it is, and again when there was no answer.
            bridge.referee.send(referee(3, 2))
            wait_for(lambda: robots.asked[0] == [1, 0, 1, 0])
            robots.opening.clear()
            wait_for(lambda: robots.asked[0] == [1, 0, 1, 0, 0])
            assert bridge.status()["robots"][0]["connects"] == 2
            assert "position2d:0" in bridge.log()


def test_a_stop_follows_at_once_what_was_asked_before(tmp_path):
    folder = tmp_path / "server"
    folder.mkdir()
    poses = 'driver ( name "fake_base" provides ["position2d:1"] )'
    with (
        Server(folder, keys='fault "hang" at "open" seconds 0.7', more=poses) as server,
        Bridge(tmp_path, [("blue", 3, server.port)]) as bridge,
    ):
        opening = wait_for(lambda: server.events("open"))[0][0]
        bridge.referee.send(referee(0))
        wait_for(lambda: bridge.status()["robots"][0]["halts"] > 0)
        assert time.monotonic() - opening < 0.8 + NOISE


def test_a_robot_that_hangs_delays_no_other(tmp_path):
    with Robots(2) as robots, Bridge(tmp_path, [("yellow", n, robots.ports[n]) for n in range(2)]) as bridge:
        bridge.connected()
        robots.deaf.add(0)
        play(bridge, 2.0, [(YELLOW, 0, 0, 0, 0), (YELLOW, 1, 1, 0, 0)])
        deaf, well = bridge.status()["robots"]
        assert len(robots.poses[1]) > 100
        assert well["superseded"] == 0 and well["latency_us"]["p50"] < 5000
        print("deaf:", deaf)


def test_bridge_connects_again(tmp_path):
    with Robots(1) as robots, Bridge(tmp_path, [("yellow", 0, robots.ports[0])]) as bridge:
        bridge.connected()
        robots.hang_up()
        wait_for(lambda: bridge.status()["robots"][0]["connects"] == 2)
        play(bridge, 0.3, [(YELLOW, 0, 0, 0, 0)])
        wait_for(lambda: robots.poses[0])


def test_tracked_vision_is_passed_on_and_published(tmp_path):
    with Robots(1) as robots:
        address = [("blue", 7, robots.ports[0])]
        with Bridge(tmp_path, address, keys='input "tracked" tracker "TIGERs" delay 0.03') as bridge:
            bridge.connected()
            for beat in range(5):
                bridge.tracked.send(tracked("other", "AutoReferee", beat, 1.0, [(2, 7, 5, 5, 0)]))
                bridge.tracked.send(tracked("ours", "TIGERs", beat, 1.0, [(2, 7, 1.5, -2, 0.5), (1, 7, 3, 3, 0)]))
            wait_for(lambda: robots.poses[0])
        _, x, y, heading, age = robots.poses[0][0]
        assert (x, y, heading) == (1.5, -2, 0.5)
        assert 0.03 <= age < 0.03 + NOISE


def test_tracked_vision_is_published_where_the_league_looks_for_it(tmp_path):
    """On 224.5.23.2:10010, read here by the numbers of the league's schema."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        heard.bind(("224.5.23.2", 10010))
        heard.setsockopt(
            socket.IPPROTO_IP,
            socket.IP_ADD_MEMBERSHIP,
            socket.inet_aton("224.5.23.2") + socket.inet_aton("127.0.0.1"),
        )
        heard.settimeout(5)
        with Bridge(tmp_path, [], keys='publish ["lo"] delay 0', usual_tracked_port=True) as bridge:
            begin = time.time()
            play(bridge, 0.5, [(BLUE, 13, 1.234, -2.5, 0.75)], balls=[(0.5, -0.25)])
            for _ in range(1000):  # others may publish there, too
                wrapper = dict(unpack(heard.recv(65536)))
                frame = unpack(wrapper[3])
                robots = [unpack(value) for number, value in frame if number == 4]
                if robots and dict(unpack(dict(robots[0])[1])) == {1: 13, 2: 2}:
                    break
    assert wrapper[2] == b"regista" and len(wrapper[1]) == 36
    (robot,) = map(dict, robots)
    assert [value for _, value in unpack(robot[2])] == pytest.approx([1.234, -2.5], abs=1e-3)  # metres
    assert robot[3] == pytest.approx(0.75, abs=1e-3)
    assert [value for _, value in unpack(robot[4])] == pytest.approx([0, 0], abs=0.05)
    assert robot[6] == pytest.approx(1)  # visibility
    fields = dict(frame)
    assert begin <= fields[2] <= time.time(), "Unix time"
    ball = dict(unpack(fields[3]))
    assert [value for _, value in unpack(ball[1])][:2] == pytest.approx([0.5, -0.25], abs=1e-3)


def test_what_is_recorded_replays(tmp_path):
    log = tmp_path / "match.log"
    seen = [(YELLOW, 0, 1, 2, 3)]
    with Robots(1) as robots:
        address = [("yellow", 0, robots.ports[0])]
        with Bridge(tmp_path, address, arguments=["--record", log]) as bridge:
            bridge.connected()
            play(bridge, 0.5, seen)
            wait_for(lambda: bridge.status()["recorder"]["written"] == 31)
        assert len(records(log)) == 31
        assert records(log)[0][1] == detection(0, 0, 0.0, seen)
        live = len(robots.poses[0])
        with Bridge(tmp_path, address, arguments=["--replay", log]) as bridge:
            assert bridge.process.wait(10) == 0
        wait_for(lambda: len(robots.poses[0]) == 2 * live)
    assert robots.poses[0][-1][1:4] == pytest.approx((1, 2, 3), abs=1e-3)


def test_errors_name_place_and_remedy(tmp_path):
    config = tmp_path / "wrong.cfg"
    for text, words, code in [
        ('robot( team "red" id 3 host "a" )', 'wrong.cfg:1:13: \'team\' must be "yellow" or "blue"', 78),
        ("vision( dely 0.1 )", "did you mean 'delay'?", 78),
        ('vision( interfaces ["nonesuch0"] )', "network interface 'nonesuch0': No such device", 71),
        (
            'vision( group "10.0.0.1" interfaces ["lo"] )',
            "cannot listen on 10.0.0.1:10006: Cannot assign requested address",
            71,
        ),
    ]:
        config.write_text(text)
        run = subprocess.run([BRIDGE, config], capture_output=True, text=True, timeout=10, check=False)
        assert words in run.stderr and run.returncode == code, run.stderr
