# SPDX-License-Identifier: Apache-2.0
"""Why a robot does not move, as the page says it. Other operators, stops, connections: test_stops.py."""

import pytest
import regista
from command_line import BIN, Server
from observer import Observer
from regista import position2d

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
    page.locator("#facts", has_text="1 faults").wait_for()


def test_a_device_that_cannot_be_opened(serve, start, visit):
    broken = 'driver ( name "fake_base" provides ["position2d:0"] fault "error" at "open" times 1000000 )'
    page = visit(start(serve(broken)), ready=False)
    page.locator("#state", has_text="FAULT").wait_for()
    page.locator("#reason", has_text="made-up fault").wait_for()


def test_a_battery_that_is_critical(serve, start, visit):
    empty = """
driver ( name "simulated_base" provides ["position2d:0"] )
driver ( name "simulated_battery" provides ["power:0"] charge 5 )
"""
    page = visit(start(serve(empty)))
    page.locator("#facts", has_text="critical: charge it").wait_for()


def test_relays_are_switched_and_say_how_they_stand(serve, start, visit):
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
    relay.focus()
    page.keyboard.press("Enter")
    page.locator("[aria-label='Relay 2'][aria-pressed=false]").wait_for()
    page.reload()
    page.locator("[aria-label='Relay 0'][aria-pressed=true]").wait_for()
    assert page.locator("[aria-label='Relay 1'][aria-pressed=true]").count() == 0
    assert page.troubles == []
