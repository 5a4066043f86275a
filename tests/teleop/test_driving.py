# SPDX-License-Identifier: Apache-2.0
"""A person at the page drives a robot; what it did is read at the server."""

import math
import re

import pytest
import regista
from observer import Observer

# A gamepad as the W3C's standard has it, which tests press: window.pad.
PAD = """
window.pad = null;
navigator.getGamepads = () => [window.pad];
window.plug = () => {
  window.pad = { index: 0, id: "Xbox (stub)", connected: true, axes: [0, 0, 0, 0],
                 buttons: Array.from({length: 17}, () => ({ pressed: false, value: 0 })) };
  window.dispatchEvent(new Event("gamepadconnected"));
};
window.unplug = () => { window.pad = null; window.dispatchEvent(new Event("gamepaddisconnected")); };
"""


@pytest.fixture
def seen(shared):
    """The robot at the origin, at rest, and observed."""
    with regista.Robot("127.0.0.1", shared[0].port) as robot:
        robot.position2d().reset_odometry()
    with Observer(shared[0]) as observer:
        observer.wait(lambda s: s.owner == "" and abs(s.pose.x) < 0.2)
        yield observer


@pytest.fixture
def page(shared, seen, visit):
    page = visit(shared[1], script=PAD, has_touch=True)
    yield page
    assert page.troubles == []


def test_keys_drive_and_letting_go_gives_the_robot_back(page, seen):
    page.keyboard.down("w")
    seen.wait(lambda s: s.pose.x > 0.3)
    assert seen.owner.startswith("teleop ")
    assert abs(seen.pose.y) < 0.1
    page.locator("#driver", has_text="driven by you").wait_for()
    page.keyboard.up("w")
    seen.wait(lambda s: s.state == "stopped" and s.owner == "")
    page.locator("#driver", has_text="driven by nobody").wait_for()


def test_keys_turn_and_slide(page, seen):
    page.keyboard.down("a")
    seen.wait(lambda s: s.pose.heading > 0.5)
    page.keyboard.up("a")
    seen.wait(lambda s: abs(s.velocity.w) < 0.1)
    heading = seen.pose.heading
    page.keyboard.down("e")  # to the right of where it looks
    seen.wait(lambda s: math.hypot(s.pose.x, s.pose.y) > 0.3)
    page.keyboard.up("e")
    assert math.atan2(seen.pose.y, seen.pose.x) == pytest.approx(heading - math.pi / 2, abs=0.2)


def test_a_gamepad_drives_while_the_dead_man_button_is_held(page, seen):
    page.evaluate("plug()")
    page.locator("#pad-name", has_text="Xbox").wait_for(state="attached")
    page.evaluate("pad.axes[1] = -1")
    page.wait_for_timeout(200)  # ten looks at the pad
    assert seen.state == "stopped"
    page.evaluate("pad.buttons[4].pressed = true")
    seen.wait(lambda s: s.pose.x > 0.3)
    page.evaluate("pad.buttons[4].pressed = false")
    seen.wait(lambda s: s.state == "stopped" and s.owner == "")


def test_a_finger_on_the_stick_drives(page, seen):
    box = page.locator("#stick").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    fingers = page.context.new_cdp_session(page)

    def touch(type_, *points):
        points = [{"x": x, "y": y} for x, y in points]
        fingers.send("Input.dispatchTouchEvent", {"type": type_, "touchPoints": points})

    touch("touchStart", (x, y))
    touch("touchMove", (x, y - 60))
    seen.wait(lambda s: s.pose.x > 0.3)
    touch("touchEnd")
    seen.wait(lambda s: s.state == "stopped" and s.owner == "")


def test_a_click_on_the_map_is_a_destination_and_dragging_sets_the_heading(page, seen):
    seen.wait(lambda s: s.state == "stopped")
    page.locator("#fit").click()
    page.locator("[data-tool=go]").click()
    box = page.locator("#canvas").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)  # the robot, since the map fits it
    page.mouse.move(middle[0] + 100, middle[1] - 60)
    page.mouse.down()
    page.mouse.move(middle[0] + 100, middle[1] - 120)  # looks up: along y
    page.mouse.up()
    page.locator("#mission-state", has_text="done").wait_for()
    x, y = seen.pose.x, seen.pose.y
    assert y / x == pytest.approx(60 / 100, abs=0.1), (x, y)
    assert math.hypot(x, y) > 0.3
    assert seen.pose.heading == pytest.approx(math.pi / 2, abs=0.15)


def test_way_points_are_driven_in_their_order_and_pause_on_stop(page, seen):
    for x, y in ((0.6, 0), (0.6, 0.6), (0, 0.6)):
        page.locator("#go-x").fill(str(x))
        page.locator("#go-y").fill(str(y))
        page.locator("#go-add").click()
    page.get_by_label("Way-point 3 earlier").click()
    page.get_by_label("Way-point 2 later").click()  # and back again
    page.locator("#mission-start").click()
    page.locator("#mission-state", has_text="1 of 3").wait_for()
    page.keyboard.press("Space")
    seen.wait(lambda s: s.state == "stopped")
    page.locator("#mission-state", has_text="paused 1 of 3: STOP").wait_for()
    page.locator("#mission-resume").click()
    page.locator("#mission-state", has_text="done 3 of 3").wait_for()
    assert (seen.pose.x, seen.pose.y) == (pytest.approx(0, abs=0.1), pytest.approx(0.6, abs=0.1))
    corner = min(math.hypot(x - 0.6, y - 0.6) for x, y in seen.track)
    assert corner < 0.2


def test_taking_the_keys_pauses_a_mission_until_somebody_resumes_it(page, seen):
    page.locator("#go-x").fill("3")
    page.locator("#go-y").fill("0")
    page.locator("#go button[type=submit]").click()
    seen.wait(lambda s: s.pose.x > 0.2)
    page.locator("h1").click()
    page.keyboard.down("s")
    seen.wait(lambda s: s.velocity.x < -0.1)
    page.keyboard.up("s")
    page.locator("#mission-state", has_text="paused: you took the controls").wait_for()
    seen.wait(lambda s: s.state == "stopped" and s.owner == "")
    page.locator("#mission-cancel").click()
    page.locator("#mission-state", has_text="paused").wait_for(state="detached")


def test_the_kicker_kicks(page, seen, shared):
    with regista.Robot("127.0.0.1", shared[0].port) as robot:
        kicker = robot.kicker()
        while kicker.count == 0:
            robot.read(1)
        before = kicker.state.kick_count
        page.locator("#charge").click()
        page.locator("#kicker-state", has_text="charged,").wait_for()
        page.locator("#kicker-state", has_not_text="not charged").wait_for()
        page.locator("#kick").click()
        while kicker.state.kick_count == before:
            assert robot.read(10)
        page.locator("#charge").click()


def test_fifty_commands_a_second_are_the_most(page, seen, shared):
    def commands():
        return next(d for d in shared[0].json("status")["drivers"] if d["name"] == "simulated_base")["commands"]

    before = commands()
    page.keyboard.down("w")
    seen.wait_driving()
    since = seen.samples[-1][0]
    seen.wait(lambda s: s.samples[-1][0] > since + 1)
    page.keyboard.up("w")
    seen.wait(lambda s: s.owner == "")
    seconds = seen.samples[-1][0] - since + 0.5
    assert 10 < commands() - before < 50 * seconds + 3


def test_the_field_that_was_chosen_is_plotted(page):
    page.locator("#field").select_option("power:0 voltage_v")
    page.locator(".u-legend", has_text="power:0 voltage_v").wait_for()


def test_a_recording_is_played_as_a_robot(page, seen, shared):
    page.locator("#record").click()
    page.locator("#recorded", has_text="MB").wait_for()
    page.keyboard.down("w")
    seen.wait(lambda s: s.pose.x > 1.5)  # the player ends with the recording: it has to show 0.3 m and more for a while
    page.keyboard.up("w")
    page.locator("#record").click()
    page.locator("#play").click()
    chip = page.locator(".chip", has_text=".mcap")
    chip.click()
    page.locator("#driver", has_text=".mcap").wait_for()
    page.locator("#moving", has_text=re.compile(r"x (0\.[3-9]|[1-9])")).wait_for()
    page.locator("#end-play").click()
    chip.wait_for(state="detached")
