# SPDX-License-Identifier: Apache-2.0
"""A field robot, whose own planner drives lists of way-points: examples/field.cfg."""

import math
import re

import numpy as np
import pytest
import regista
from command_line import owned, wait_for
from gateway import program, serving
from observer import Observer
from regista import Pose2d, localize, planner
from test_stops import HIDE


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    with serving("field.cfg", tmp_path_factory.mktemp("recordings")) as both:
        yield both


@pytest.fixture
def ask(field):
    """What the planner says of its mission."""
    with regista.Robot("127.0.0.1", field[0].port, name="asker") as robot:
        device = robot.device("planner:0")
        localizer = robot.position2d(2)
        while localizer.count == 0:  # it is silent until it knows where it is
            robot.read(timeout=1)
        yield lambda: device.request(planner.GetMission())


@pytest.fixture
def seen(field, ask):
    with Observer(field[0]) as observer:
        yield observer


@pytest.fixture
def page(field, seen, visit):
    page = visit(field[1])
    page.locator("#facts", has_text="tracking").wait_for()
    page.locator("#motors", has_text=re.compile("o(n|ff)$")).wait_for()
    if "off" in page.locator("#motors").inner_text():  # its drives have no voltage before
        page.locator("#reason", has_text="the motors are off").wait_for()
        page.locator("#motors").click()
        page.locator("#motors", has_text="Motor power: on").wait_for()
    yield page
    if page.locator("#mission-cancel").is_visible():
        page.locator("#mission-cancel").click()
    seen.wait(lambda s: s.owner == "")
    assert page.troubles == []


def upload(page, *points):
    for x, y in points:
        page.locator("#go-x").fill(str(round(x, 2)))
        page.locator("#go-y").fill(str(round(y, 2)))
        page.locator("#go-add").click()
    page.locator("#mission-start").click()


def ahead(ask, field, *distances):
    """Points on the way that the robot looks along."""
    with regista.Robot("127.0.0.1", field[0].port) as robot:
        localizer = robot.position2d(2)
        while localizer.count == 0:
            robot.read(timeout=1)
        pose = localizer.state.pose
    return [(pose.x + d * math.cos(pose.heading), pose.y + d * math.sin(pose.heading)) for d in distances]


def test_the_planner_drives_the_way_points_pauses_and_goes_on(page, field, seen, ask, accessible):
    points = ahead(ask, field, 1.0, 2.0)
    upload(page, *points)
    page.locator("#driver", has_text="driven by planner:0 for you").wait_for()
    seen.wait_driving()
    assert [ask().count, ask().state] == [2, planner.MissionState.driving]
    page.locator("#mission-pause").click()
    page.locator("#mission-state", has_text="paused").wait_for()
    wait_for(lambda: ask().state is planner.MissionState.paused)
    seen.wait(lambda s: s.state == "stopped")
    page.locator("#reason", has_text="you paused it").wait_for()
    accessible(page)
    page.locator("#mission-resume").click()
    page.locator("#mission-state", has_text="done 2 of 2").wait_for()
    assert ask().state is planner.MissionState.finished
    with regista.Robot("127.0.0.1", field[0].port) as robot:
        truth = robot.position2d(1)
        while truth.count == 0:
            robot.read(timeout=1)
        pose = truth.state.pose
    assert math.hypot(pose.x - points[-1][0], pose.y - points[-1][1]) < 1


def test_a_hand_takes_the_robot_from_its_planner_until_resume(page, field, seen, ask):
    upload(page, *ahead(ask, field, 5.0))
    seen.wait_driving()
    page.locator("h1").click()
    page.keyboard.down("s")
    seen.wait(lambda s: s.velocity.x < -0.1)
    assert seen.owner.startswith("teleop ")
    page.keyboard.up("s")
    page.locator("#mission-state", has_text="paused: you took the controls").wait_for()
    seen.wait(lambda s: s.state == "stopped" and s.owner == "")
    assert ask().state is planner.MissionState.paused


def test_stop_stops_a_planner_and_a_hidden_page_pauses_it(page, field, seen, ask):
    upload(page, *ahead(ask, field, 5.0))
    seen.wait_driving()
    page.keyboard.press("Space")
    page.locator("#mission-state", has_text="paused: STOP").wait_for()
    seen.wait(lambda s: s.state == "stopped")
    page.locator("#mission-resume").click()
    seen.wait_driving()
    page.evaluate(HIDE)
    page.locator("#mission-state", has_text="paused: the page is hidden").wait_for()
    wait_for(lambda: ask().state is planner.MissionState.paused)
    seen.wait(lambda s: s.state == "stopped")


def test_a_hidden_page_pauses_a_mission_that_asks(page, field, ask):
    (here,) = ahead(ask, field, 0.0)
    question = planner.Action(point=0, act=planner.Act.ask)
    with regista.Robot("127.0.0.1", field[0].port, name="nav@laptop") as robot:
        upload = planner.SetMission(id="asks", points=[Pose2d(*here, 0)], actions=[question])
        robot.device("planner:0").request(upload)
    page.locator("#mission-state", has_text="uploaded, not started").wait_for()
    page.locator("#mission-resume").click()
    page.locator("#mission-state", has_text="asks; Resume is the answer").wait_for()
    page.evaluate(HIDE)
    wait_for(lambda: ask().state is planner.MissionState.paused)


def programmed(server, points):
    """Another program's mission, kept alive."""

    def drive(robot, ended):
        device = robot.device("planner:0")
        poses = [Pose2d(x, y, 0) for x, y in points]
        device.request(planner.SetMission(id="survey", points=poses, actions=[]))
        device.send(planner.RunCommand(id="survey"))
        device.keep_alive(True)
        while not ended():
            robot.read(timeout=0.05)

    return program(server, drive)


def test_another_programs_mission_is_shown_and_taken_over_only_on_purpose(page, field, seen, ask):
    with programmed(field[0], ahead(ask, field, 8.0)):
        page.locator("#driver", has_text="driven by planner:0 for nav@laptop (priority 10)").wait_for()
        page.locator("#mission-state", has_text="running").wait_for()
        page.locator("#go button[type=submit]").click()
        page.locator("#log", has_text="nav@laptop drives planner:0: take over first").wait_for()
        assert ask().id == "survey"
        page.locator("#take").click()
        page.locator("#driver", has_text="driven by you").wait_for()
        wait_for(lambda: ask().state is planner.MissionState.paused)


def test_a_mission_that_fails_says_why(page, field, seen, ask):
    upload(page, *ahead(ask, field, 5.0))
    seen.wait_driving()
    with owned(field[0], "umpire", 20):  # the base, from under its planner
        page.locator("#mission-state", has_text=re.compile("failed: the base does not do what it is told")).wait_for()
    page.locator("#reason", has_text="mission failed: the base does not").wait_for()
    page.locator("#log", has_text="the base does not do what it is told").wait_for()


ELLIPSES = """
window.ellipses = [];
const draw = CanvasRenderingContext2D.prototype.ellipse;
CanvasRenderingContext2D.prototype.ellipse = function (...values) {
  window.ellipses = [values];
  return draw.apply(this, values);
};
"""


def test_the_ellipse_is_what_the_localizer_believes(field, ask, visit):
    ask()
    page = visit(field[1], script=ELLIPSES)
    page.wait_for_function("ellipses.length > 0")
    with regista.Robot("127.0.0.1", field[0].port) as robot:
        device = robot.device("localize:1")
        while device.latest(localize.State).count == 0:
            robot.read(timeout=1)
        (best,) = device.latest(localize.State).value.hypotheses
    xx, yy, _, xy = best.covariance[:4]
    smaller, larger = np.sqrt(np.linalg.eigvalsh(np.array([[xx, xy], [xy, yy]])))
    _, _, a, b, *_ = page.evaluate("ellipses[0]")
    assert a >= b > 0
    assert a / b == pytest.approx(larger / smaller, rel=0.25)


def test_way_points_have_latitudes_and_longitudes(page):
    for x, y in ((0, 0), (100, 0), (0, 100)):
        page.locator("#go-x").fill(str(x))
        page.locator("#go-y").fill(str(y))
        page.locator("#go-add").click()
    page.locator("#points li", has_text="63.4").nth(2).wait_for()
    shown = [re.search(r"\((.*), (.*)\)", text) for text in page.locator("#points li").all_inner_texts()]
    (lat0, lon0), (_, lon1), (lat1, _) = [(float(one[1]), float(one[2])) for one in shown]
    assert (lat0, lon0) == (
        pytest.approx(63.4178, abs=3e-6),
        pytest.approx(10.4018, abs=5e-6),
    )  # the datum in field.cfg
    # The length of a degree, as series in the latitude: American Practical Navigator (NGA), 2002, table 7.
    phi = math.radians(lat0)
    north = 111132.92 - 559.82 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi)
    east = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)
    assert lat1 - lat0 == pytest.approx(100 / north, abs=2e-6)
    assert lon1 - lon0 == pytest.approx(100 / east, abs=2e-6)
    page.locator("#facts", has_text=re.compile("GPS.*satellites, ±")).wait_for()
