# SPDX-License-Identifier: Apache-2.0
"""Vision that regista-vision-bridge was not made on: other cameras, other noise, and all that goes wrong, at once and
by chance, through real multicast. The truth is known."""

import itertools
import math
import time
from random import Random

import pytest
from field import in_real_time
from league import BLUE, BRIDGE, VISION_GROUP, YELLOW, Bridge, Robots, Sender, detection, deviation

pytestmark = pytest.mark.skipif(not BRIDGE.exists(), reason="built without REGISTA_VISION")
TEAMS = {"yellow": YELLOW, "blue": BLUE}
RATE = 75


class Field:
    """Eleven robots a side, at rest, and what cameras make of them."""

    def __init__(self, seed, columns, noise_m, noise_rad, disagree):
        self.random = Random(seed)
        self.noise_m, self.noise_rad = noise_m, noise_rad
        chance = self.random
        self.cameras = [
            {
                "from": -6 + 12 * column / columns - 0.4,
                "to": -6 + 12 * (column + 1) / columns + 0.4,
                "off": (chance.uniform(-disagree, disagree) / 2, chance.uniform(-disagree, disagree) / 2),
                "phase": chance.random() / RATE,
                "clock": chance.uniform(-1e6, 2e9),
                "number": chance.randrange(1 << 20),
                "held": None,
            }
            for column in range(columns)
        ]
        self.poses = {}
        for team, side in (("yellow", 1), ("blue", -1)):
            for robot in range(11):
                place = (-4.2 + 0.8 * robot + chance.uniform(-0.1, 0.1), side * chance.uniform(0.5, 3))
                self.poses[team, robot] = (*place, chance.uniform(-math.pi, math.pi))
        self.off = set()  # turned off, and carried away
        self.swapped = {}  # read as another one

    def see(self, number, wrong=True):
        """[what detection() takes] of one camera."""
        chance, camera = self.random, self.cameras[number]
        seen = []
        for name, (x, y, heading) in self.poses.items():
            if name in self.off or not camera["from"] < x < camera["to"] or chance.random() < 0.02:
                continue
            if wrong and chance.random() < 0.02:
                heading += chance.choice((-1, 1)) * math.pi / 2
            team, robot = self.swapped.get(name, name)
            x += camera["off"][0] + chance.gauss(0, self.noise_m)
            y += camera["off"][1] + chance.gauss(0, self.noise_m)
            seen.append((TEAMS[team], robot, x, y, heading + chance.gauss(0, self.noise_rad)))
        if wrong and chance.random() < 0.1:  # a ghost, often of a robot that is elsewhere
            name = (chance.choice(("yellow", "blue")), chance.randrange(16))
            if name not in self.off:
                place = (chance.uniform(-4, 4), chance.uniform(-3, 3), chance.uniform(-3, 3))
                seen.append((TEAMS[name[0]], name[1], *place))
        return seen


def play(field, bridge, seconds, other_host=None):
    """Frames of all cameras as they fall due: some twice, some in the wrong order."""
    chance = field.random
    begin = time.monotonic()
    dues = sorted(
        (camera["phase"] + beat / RATE, number)
        for number, camera in enumerate(field.cameras)
        for beat in range(int(seconds * RATE))
    )
    for due, number in dues:
        time.sleep(max(0.0, begin + due - time.monotonic()))
        camera = field.cameras[number]
        camera["number"] += 1
        now = time.monotonic()
        captured = camera["clock"] + now - chance.uniform(0.006, 0.009)
        packet = detection(number, camera["number"], captured, field.see(number), t_sent=camera["clock"] + now)
        if other_host and number == 0:  # somebody's second computer, which sees a field of its own
            astray = [(team, robot, -x, -y, heading) for team, robot, x, y, heading in field.see(0)]
            other_host.send(detection(0, camera["number"] + 7, now, astray, t_sent=now))
        if camera["held"]:
            bridge.vision.send(packet)
            packet, camera["held"] = camera["held"], None
        elif chance.random() < 0.02:
            camera["held"] = packet
            continue
        for _ in range(2 if chance.random() < 0.02 else 1):
            bridge.vision.send(packet)


def calm(poses, since, until):
    return [pose for pose in poses if since < pose[0] < until]


@pytest.mark.parametrize(
    ("seed", "columns", "noise_m", "noise_rad", "disagree"),
    [(11, 1, 0.003, 0.02, 0), (24, 2, 0.001, 0.03, 0.04), (13, 5, 0.0013, 0.010, 0.04)],
)
def test_robots_stand_still_whatever_goes_wrong(tmp_path, seed, columns, noise_m, noise_rad, disagree):
    @in_real_time
    def once(folder):
        stand_still(folder, Field(seed, columns, noise_m, noise_rad, disagree))

    once(tmp_path)


def stand_still(folder, field):
    names = [*field.poses, ("yellow", 15)]  # the last is not on the field
    with Robots(len(names)) as robots:
        addresses = [(*name, port) for name, port in zip(names, robots.ports, strict=True)]
        of = dict(zip(names, robots.poses, strict=True))
        with Bridge(folder, addresses, keys="delay 0.02") as bridge:
            bridge.connected()
            other_host = Sender(VISION_GROUP, bridge.vision_port)
            play(field, bridge, 1.0)
            settled = time.monotonic()
            play(field, bridge, 1.5, other_host)
            for camera in field.cameras:  # the vision computer sets its clock
                camera["clock"] += field.random.choice((-3600, 3600))
            play(field, bridge, 0.5)
            # Two that stand near each other are read as each other, for five frames.
            pair = min(itertools.combinations(field.poses, 2), key=lambda p: apart(*(field.poses[n] for n in p)))
            field.swapped = dict(zip(pair, reversed(pair), strict=True))
            play(field, bridge, 5 / RATE)
            field.swapped = {}
            play(field, bridge, 0.5)
            rest = time.monotonic()
            moved = {}
            for name in (("yellow", 2), ("blue", 7)):
                x, y, heading = field.poses[name]
                field.poses[name] = (-x, -y + 0.7, heading + 2)
                moved[name] = time.monotonic()
            gone = ("blue", 4)
            field.off.add(gone)
            play(field, bridge, 1.0)
            ended = time.monotonic()
            status = bridge.status()
            other_host.close()
    worst_m = worst_rad = worst_off = 0.0
    for name in names[:-1]:
        poses = calm(of[name], settled, rest)
        assert len(poses) > 0.8 * RATE * (rest - settled), f"{name} is hardly seen"
        x, y, heading = field.poses[name] if name not in moved else (None, None, None)
        worst_m = max(worst_m, *(deviation([pose[i] for pose in poses]) for i in (1, 2)))
        worst_rad = max(worst_rad, deviation([math.remainder(pose[3] - poses[0][3], math.tau) for pose in poses]))
        if x is not None:
            worst_off = max(worst_off, *(math.hypot(pose[1] - x, pose[2] - y) for pose in poses))
            assert max(abs(math.remainder(pose[3] - heading, math.tau)) for pose in poses) < 0.1, f"{name} turns"
    found = []
    for name, since in moved.items():
        x, y, heading = field.poses[name]
        there = [p[0] for p in of[name] if p[0] > since and math.hypot(p[1] - x, p[2] - y) < 0.05]
        found.append(there[0] - since)
        after = calm(of[name], there[0] + 0.1, ended)
        assert all(math.hypot(p[1] - x, p[2] - y) < 0.05 for p in after), f"{name} does not stay"
    print(f"{len(field.cameras)} cameras: at rest {1e3 * worst_m:.2f} mm, {1e3 * worst_rad:.2f} mrad,")
    print(f"off the truth by {1e3 * worst_off:.1f} mm; found again in {', '.join(f'{1e3 * t:.0f}' for t in found)} ms")
    print({camera["id"]: (camera["late"], camera["duplicates"], camera["foreign"]) for camera in status["cameras"]})
    print(status["refused"])
    assert worst_m < 0.001 and worst_rad < 0.005
    assert worst_off < 0.03, "half of what cameras disagree by, and noise"
    assert max(found) < 0.2
    assert not of["yellow", 15], "a ghost"
    assert not calm(of[gone], moved["blue", 7] + 0.1, ended), "nobody sees it"
    assert all(camera["foreign"] > 0 for camera in status["cameras"] if camera["id"] == 0)


def apart(a, b):
    return math.hypot(a[0] - b[0], a[1] - b[1])
