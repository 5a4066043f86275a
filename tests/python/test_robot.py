# SPDX-License-Identifier: Apache-2.0
"""Robots and proxies beside a real server with simulated devices."""

import itertools
import math
import time

import pytest
import regista
from regista import imu, position1d, position2d
from scripted import obliging


@pytest.fixture
def robot(port):
    with regista.Robot("127.0.0.1", port, name="test@python") as robot:
        yield robot


def until(robot, what, timeout=10.0):
    """Read until `what()`."""
    end = time.monotonic() + timeout
    while not what():
        assert time.monotonic() < end, "it did not happen"
        robot.read(timeout=0.1)


def test_a_square_by_velocities(robot):
    """The ten lines of the README, four times and turning: it ends where it began."""
    base = robot.position2d()
    base.reset_odometry()
    for side in range(4):
        heading = side * math.pi / 2
        begin = base.state.pose
        while math.hypot(base.state.pose.x - begin.x, base.state.pose.y - begin.y) < 0.4:
            base.set_velocity(x=0.8)
            robot.read(timeout=0.1)
        while math.remainder(base.state.pose.heading - heading - math.pi / 2, math.tau) < -0.02:
            base.set_velocity(w=1.5)
            robot.read(timeout=0.1)
    base.stop()
    until(robot, lambda: math.hypot(base.state.velocity.x, base.state.velocity.w) < 0.1)
    assert math.hypot(base.state.pose.x, base.state.pose.y) < 0.3


def test_a_square_by_destinations(robot):
    base = robot.position2d()
    base.reset_odometry()
    base.follow([(0.3, 0), (0.3, 0.3), regista.Pose2d(0, 0.3, 0), (0, 0, 0)], timeout=20)
    assert base.is_at(0, 0)
    assert not base.is_at(0.3, 0)
    base.drive_to(0.1, 0, timeout=10, distance_m=0.02)
    assert base.is_at(0.1, 0, distance_m=0.02)


def test_values_change_in_read_and_only_there(robot):
    base = robot.position2d()
    while base.count == 0:
        assert robot.read(timeout=2)
    before, count = base.state, base.count
    time.sleep(0.05)
    assert base.state is before and base.count == count
    assert base.age is not None and base.age >= 0.05
    while base.count == count:
        assert robot.read(timeout=2)
    assert base.state is not before and base.count > count
    assert base.age < 1


def test_nothing_is_known_before_the_first_data(robot):
    power = robot.power()
    assert (power.age, power.count, power.voltage_v) == (None, 0, None)
    until(robot, lambda: power.count)
    assert 10 < power.voltage_v < 15
    assert power.charge_percent == pytest.approx(100, abs=5)
    assert power.energy_j > 0
    assert power.power_w > 0


def test_a_read_that_finds_nothing_ends_in_time(scripted):
    with regista.Robot("127.0.0.1", scripted(obliging).port) as robot:
        begin = time.monotonic()
        assert not robot.read(timeout=0.2)
        assert 0.2 <= time.monotonic() - begin < 2
        with pytest.raises(ValueError, match="wants seconds"):
            robot.read(timeout=-1)
        with regista.Team([robot]) as team:
            assert not team.read(timeout=0.05)


def test_kicker(robot):
    kicker = robot.kicker()
    assert kicker.limits().kick_speed_mps == pytest.approx(6.5)
    assert kicker.geometry().pose.x == pytest.approx(0.08)
    kicker.charge(True)
    until(robot, lambda: kicker.state.charged)
    kicks = kicker.state.kick_count
    kicker.kick(5.0)
    until(robot, lambda: kicker.state.kick_count == kicks + 1)
    until(robot, lambda: kicker.state.charged)
    kicker.chip(3.0, math.radians(45))
    until(robot, lambda: kicker.state.kick_count == kicks + 2)
    kicker.dribble(100)
    until(robot, lambda: kicker.state.dribbler_radps > 20)
    kicker.kick(99.0)
    until(robot, lambda: any("kick speed is 99 m/s" in event.text for event in robot.events()))


def test_opaque(robot):
    lamps = robot.opaque()
    assert lamps.request_bytes(b"how many?") == b"\3"
    lamps.send_bytes(bytes([9, 8, 7]))
    until(robot, lambda: lamps.bytes == bytes([9, 8, 7]))


def test_generic_devices_send_ask_and_tell(robot):
    table = robot.device("position1d:0")
    assert repr(table).startswith("<Device position1d:0 at 127.0.0.1:")
    assert table.driver == "turntable"
    assert table.request(position1d.GetGeometry()).size.width == pytest.approx(0.3)
    table.send(position1d.PositionCommand(position=0.2))
    table.keep_alive(True)
    until(robot, lambda: table.latest(position1d.State).value.position > 0.1)
    sample = table.latest("STATE")
    assert sample.value == table.latest(position1d.State).value
    assert sample.count == table.count > 0
    assert abs(sample.arrival - time.monotonic()) < 10
    assert abs(sample.stamp - time.time()) < 10
    with pytest.raises(regista.RefusedError, match=r"SET_ODOM refused: .*stop it first"):
        table.request(position1d.SetOdometry(position=0.0))


def test_devices_are_the_same_objects_by_any_name(robot):
    assert robot.device("position2d:0") is robot.device("position2d") is robot.position2d()
    assert [info.address for info in robot.devices()] == [
        "position2d:0",
        "power:0",
        "kicker:0",
        "opaque:0",
        "position1d:0",
    ]


@pytest.mark.parametrize("address", ["posision2d:0", "player:0", "position2d:x", "position1d:70000", ""])
def test_what_is_no_device_is_a_value_error(robot, address):
    with pytest.raises(ValueError, match=r"is no (device|interface)"):
        robot.device(address)


def test_properties_have_their_drivers_type(robot):
    base = robot.position2d()
    base.set_property("noise", 0.02)
    assert base.property("noise") == base.property("noise", float) == 0.02
    base.set_property("noise", 0.01)
    kicker = robot.kicker()
    kicker.set_property("ball", True)
    assert kicker.property("ball") is True
    with pytest.raises(regista.RefusedError) as raised:
        base.set_property("noise", 1)
    assert raised.value.reason == "property 'noise' is of another type"
    assert (raised.value.device, raised.value.asked) == ("position2d:0", "SET_PROPERTY")
    assert (raised.value.host, raised.value.port) == (robot.host, robot.port)
    with pytest.raises(regista.RefusedError):
        base.property("noize")
    with pytest.raises(TypeError, match="a property is a float, an int, a bool or a str"):
        base.set_property("noise", [1])  # type: ignore[arg-type]


def test_who_drives_and_who_may(robot, port):
    base = robot.position2d()
    base.set_velocity(x=0.1)
    until(robot, lambda: base.motion().owner == "test@python")
    assert base.motion().lease_s == 1.0
    with regista.Robot("127.0.0.1", port, name="boss@python", priority=20) as boss:
        other = boss.position2d()
        other.take()
        until(robot, lambda: base.motion().owner == "boss@python")
        with pytest.raises(regista.RefusedError, match="boss@python"):
            base.take()
        other.release()
        until(robot, lambda: base.motion().owner == "")


def test_status_events_counters(robot):
    assert "clients" in robot.status()
    assert robot.extended and robot.connected and robot.generation == 1
    assert robot.server.startswith("regista")
    assert robot.counters()["stray"] == 0
    base = robot.position2d()
    base.set_velocity(x=0.1)
    until(robot, lambda: base.count > 10)
    robot.stop()
    until(robot, lambda: any('"test@python" asked for a stop' in event.text for event in robot.events()))


def test_a_stop_says_who_asked_for_it_also_when_it_has_opened_nothing(robot, port):
    base = robot.position2d()
    base.set_velocity(x=0.1)
    until(robot, lambda: base.motion().owner == "test@python")
    with regista.Robot("127.0.0.1", port, name="umpire@field") as umpire:
        umpire.stop()
    until(robot, lambda: base.motion().reason == '"umpire@field" asked for a stop')


def test_not_finite_is_refused_at_once(robot):
    base = robot.position2d()
    for value in (math.nan, math.inf):
        with pytest.raises(ValueError, match="not a finite number"):
            base.set_velocity(x=value)
        with pytest.raises(ValueError, match="not a finite number"):
            base.go_to(value, 0)


def test_geometry_and_settings_are_asked_and_refused_with_reasons(robot):
    base = robot.position2d()
    assert base.geometry().size.length == pytest.approx(0.18)
    base.set_motor_power(True)
    base.set_position_mode(True)
    robot.power().set_charging_policy(input=True, output=False)
    base.set_odometry(1.0, 2.0, 0.5)
    until(robot, lambda: abs(base.state.pose.x - 1.0) < 0.05 and abs(base.state.pose.y - 2.0) < 0.05)
    for ask in (
        lambda: base.set_speed_pid(1, 0, 0),
        lambda: base.set_position_pid(1, 0, 0),
        lambda: base.set_speed_profile(1, 1),
    ):
        with pytest.raises(regista.RefusedError) as raised:
            ask()
        assert raised.value.reason and raised.value.asked


def test_every_message_is_recorded_in_order(robot):
    base = robot.position2d()
    assert robot.messages() == []
    robot.record(limit=50)
    count = base.count
    until(robot, lambda: base.count - count >= 20)
    messages = robot.messages()
    assert len(messages) == base.count - count
    assert {m.device for m in messages} == {"position2d:0"}
    assert all(isinstance(m.message, position2d.State) for m in messages)
    assert all(a.stamp < b.stamp and a.arrival <= b.arrival for a, b in itertools.pairwise(messages))
    assert messages[-1].message == base.state
    until(robot, lambda: base.count - count >= 120)
    assert len(robot.messages()) == 50
    assert robot.counters()["overflows"] >= 50
    robot.record(limit=0)
    robot.read(timeout=1)
    assert robot.messages() == []


def test_a_team_reads_all(port):
    with regista.Team() as team:
        for _ in range(2):
            team.add(regista.Robot("127.0.0.1", port))
        assert len(team) == 2
        bases = [robot.position2d() for robot in team]
        counts = [base.count for base in bases]
        end = time.monotonic() + 10
        while any(base.count < count + 5 for base, count in zip(bases, counts, strict=True)):
            assert team.read(timeout=1)
            assert time.monotonic() < end


def test_what_is_closed_says_so(port):
    robot = regista.Robot("127.0.0.1", port)
    base = robot.position2d()
    robot.close()
    robot.close()
    for use in (lambda: robot.read(0), lambda: base.state, lambda: base.set_velocity(), robot.status, base.geometry):
        with pytest.raises(ValueError, match="this robot is closed"):
            use()


def test_pull_mode_reads_the_same(port):
    with regista.Robot("127.0.0.1", port, mode="pull") as robot:
        base = robot.position2d()
        until(robot, lambda: base.count >= 3)
    with pytest.raises(ValueError, match='mode is "push" or "pull"'):
        regista.Robot("127.0.0.1", port, mode="drag")  # type: ignore[arg-type]


def test_data_types_belong_to_their_interface(robot):
    with pytest.raises(TypeError, match="no data of interface position2d"):
        robot.position2d().latest(imu.State)
    with pytest.raises(TypeError, match="no data of interface position2d"):
        robot.position2d().latest("STAT")
