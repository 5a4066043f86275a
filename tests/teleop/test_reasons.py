# SPDX-License-Identifier: Apache-2.0
"""Why a robot does not move, as the page says it. Other operators, stops, connections: test_stops.py."""

import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
import regista
from command_line import BIN, ROOT, Server, wait_for
from gateway import Gateway
from observer import Observer
from regista import position2d

sys.path += [str(ROOT / "tests" / folder) for folder in ("canopen", "vision")]
FAULTS = BIN.parent / "lib/regista-faults"


@pytest.fixture
def serve(tmp_path):
    """Start a server of these drivers."""
    servers = []

    def serve_one(text):
        config = tmp_path / "robot.cfg"
        config.write_text(text)
        servers.append(Server(config, options=["--plugins", FAULTS, "--"]).__enter__())
        return servers[-1]

    yield serve_one
    for server in servers:
        server.__exit__()


def test_motors_that_somebody_switched_off(shared, visit):
    robot, gateway = shared
    page = visit(gateway)
    with regista.Robot("127.0.0.1", robot.port, name="mechanic") as mechanic:
        mechanic.position2d().request(position2d.SetMotorPower(on=0))
    page.keyboard.down("w")
    page.locator("#reason", has_text="the motors are off: switch Motor power on").wait_for()
    page.keyboard.up("w")
    page.locator("#motors", has_text="Motor power: off").click()
    page.locator("#motors", has_text="Motor power: on").wait_for()
    with Observer(robot) as seen:
        page.keyboard.down("w")
        seen.wait_driving()
        page.keyboard.up("w")
        seen.wait(lambda s: s.owner == "")
    assert page.troubles == []


def test_a_driver_that_hangs(serve, start, visit):
    hangs = 'driver ( name "fake_base" provides ["position2d:0"] fault "hang" at "command" after 1 seconds 8 )'
    page = visit(start(serve(hangs)))
    page.keyboard.down("w")
    page.locator("#state", has_text="FAULT").wait_for()
    page.locator("#reason", has_text="hang").wait_for()
    page.locator("#facts", has_text="its driver hangs").wait_for()
    page.keyboard.up("w")
    page.locator("#state", has_text="STOPPED").wait_for()


def test_a_driver_that_fails(serve, start, visit):
    fails = 'driver ( name "fake_base" provides ["position2d:0"] fault "throw" at "command" after 1 times 1 )'
    page = visit(start(serve(fails)))
    page.keyboard.down("w")
    page.locator("#log", has_text="made-up fault").wait_for()
    page.keyboard.up("w")
    page.locator("#facts", has_text="1 fault").wait_for()


def test_a_device_that_cannot_be_opened(serve, start, visit):
    broken = 'driver ( name "fake_base" provides ["position2d:0"] fault "error" at "open" times 1000000 )'
    page = visit(start(serve(broken)), ready=False)
    page.locator("#state", has_text="FAULT").wait_for()
    page.locator("#reason", has_text="made-up fault").wait_for()


def test_a_battery_that_is_critical(serve, start, visit, accessible):
    empty = """
driver ( name "simulated_base" provides ["position2d:0"] )
driver ( name "simulated_battery" provides ["power:0"] charge 5 )
"""
    page = visit(start(serve(empty)))
    page.locator("#facts", has_text="critical: charge it").wait_for()
    accessible(page)


def test_relays_are_switched_and_say_how_they_stand(serve, start, visit, accessible):
    page = visit(
        start(
            serve("""
driver
(
  name "can_motor"
  provides ["actarray:0" "power:0" "dio:0"]
  bus "simulated"
  nodes [5 6]
  gear 20
  velocity_unit 0.1
  increments 4096
  wheel_speed 1200
  relays ["5 60FE:01 16" "5 60FE:01 17" "6 60FE:01 16"]
)
driver ( name "differential" provides ["position2d:0"] requires ["actarray:0"] wheel_radius 0.1 track 0.42 )
""")
        )
    )
    relay = page.get_by_role("button", name="Relay 2")
    relay.click()
    page.locator("[aria-label='Relay 2'][aria-pressed=true]").wait_for()
    page.get_by_role("button", name="Relay 0").click()
    page.locator("[aria-label='Relay 0'][aria-pressed=true]").wait_for()
    accessible(page)
    relay.focus()
    page.keyboard.press("Enter")
    page.locator("[aria-label='Relay 2'][aria-pressed=false]").wait_for()
    page.reload()
    page.locator("[aria-label='Relay 0'][aria-pressed=true]").wait_for()
    assert page.locator("[aria-label='Relay 1'][aria-pressed=true]").count() == 0
    assert page.troubles == []


def test_a_drive_that_tells_an_emergency(start, visit, tmp_path):
    from test_can_motor import LEFT, Robot  # drives of their own, on a bus in user space

    with Robot(tmp_path) as robot:
        robot.up()
        page = visit(start(SimpleNamespace(robot=f"127.0.0.1:{robot.server.port}")))
        over_voltage = ["write", str(LEFT), "2002", "0x3210", "--type", "unsigned16"]
        subprocess.run([BIN / "regista-can", "-b", robot.bus, *over_voltage], check=True)
        page.locator("#log", has_text="node 5: EMCY 0x3210 DC link over-voltage").wait_for()
        page.keyboard.down("w")
        page.locator("#reason", has_text="the motors are off: switch Motor power on").wait_for()
        page.keyboard.up("w")


def test_a_referee_who_halts_the_game(robot, tmp_path, visit):
    from league import Bridge, referee

    halt, force_start = 0, 3
    with Bridge(tmp_path, [("blue", 3, robot.port, 0)]) as bridge:
        address = wait_for(lambda: re.search(r"http://([^/\s]+)", bridge.log()))[1]
        gateway = Gateway(robot.robot, folder=tmp_path, options=("--vision", address))
        try:
            page = visit(gateway)
            page.keyboard.down("w")
            page.locator("#state", has_text="DRIVING").wait_for()
            bridge.referee.send(referee(halt))
            page.locator("#reason", has_text="HALT: the referee stopped it").wait_for()
            page.locator("#state", has_text="STOPPED").wait_for()
            bridge.referee.send(referee(force_start, 2))
            page.keyboard.up("w")
            page.locator("#reason", has_text="HALT").wait_for(state="detached")
        finally:
            gateway.end()
